"""Results of `lcbayes observability`, as numbers for files and as text."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.text import join_words
from lcbayes.physics.bodies.facets import grid
from lcbayes.physics.sensitivity import MAGNITUDE_PER_NEPER
from lcbayes.simulation.observability.campaign import Campaign
from lcbayes.simulation.observability.campaign_plan import Plan
from lcbayes.simulation.observability.linearity import MAX_NONLINEARITY
from lcbayes.simulation.observability.measurements import Measurements, over_directions
from lcbayes.simulation.observability.parameters import Parameter
from lcbayes.simulation.observability.trades import Trade
from lcbayes.simulation.scenarios.scenario import PrincipalAxis, Scenario

Floats = NDArray[np.float64]
COLUMNS = (
    "rank",
    "utc",
    "t_s",
    "site",
    "duration_s",
    "n_measurements",
    "range_km",
    "phase_deg",
    "mag",
    "gain_nats",
    "sd_after",
)
MAP_DIRECTIONS = 20_000


@dataclass(frozen=True)
class Findings:
    """All results of a run of the command; `nonlinearity` (P,) is that of `linearity`."""

    scenario: Scenario
    measured: Measurements
    campaign: Campaign
    trades: list[Trade]
    nonlinearity: Floats
    plan: Plan | None = None
    notes: tuple[str, ...] = ()

    @property
    def most_informative(self) -> int:
        """Index of the measurement with most information on the attitude."""
        return int(np.argmax(self.measured.information))

    def map_information(self, directions: Floats) -> Floats:
        """Information (1/rad²) of a measurement from any body-frame direction (G, 3).

        Sun direction and noise are those of the most informative measurement. The noise is constant
        in flux or in magnitude, according to the noise of the scenario.
        """
        m, i = self.measured, self.most_informative
        flux, gradient = over_directions(self.scenario, m.sun_body[i], directions)
        square = np.sum(gradient**2, axis=1)
        if self.scenario.noise.kind == "mag_err" or self.scenario.kind == "mag":
            relative = m.mag_err[i] / MAGNITUDE_PER_NEPER
            return np.where(flux > 0.0, square / np.where(flux > 0, flux * relative, 1.0) ** 2, 0.0)
        sd = m.flux[i] * m.mag_err[i] / MAGNITUDE_PER_NEPER
        return square / sd**2


def numbers(findings: Findings) -> dict[str, Any]:
    """The content of `observability.json`."""
    m, c = findings.measured, findings.campaign
    curve = m.curve
    directions = grid(MAP_DIRECTIONS)
    information = findings.map_information(directions)
    i, best = findings.most_informative, int(np.argmax(information))
    return {
        "scenario": findings.scenario.name,
        "n_measurements": curve.n_obs,
        "frame": curve.frame,
        "epoch_jd": curve.epoch_jd,
        "flux_unit": "m2, at unit distance under unit irradiance" if not m.apparent else "W/m2",
        "mag_is": "apparent" if m.apparent else "-2.5 log10 of the flux, the range being unknown",
        "notes": list(findings.notes),
        "measurements": [
            {
                "t": curve.t[k],
                "site": str(curve.site[k]),
                "mag": m.mag[k],
                "mag_err": m.mag_err[k],
                "mag_gradient": m.mag_gradient[k],
                "flux_gradient": m.flux_gradient[k],
                "information": m.information[k],
                "rank": int(m.information[k] > 0.0),
                "nullspace": m.nullspace[k],
            }
            for k in range(curve.n_obs)
        ],
        "campaign": {
            "parameters": list(c.unknowns.names),
            "units": [p.unit for p in c.unknowns.parameters],
            "prior_sd": c.unknowns.prior_sd,
            "fisher": c.fisher,
            "crlb_sd": c.bound,
            "crlb_sd_with_prior": c.bound_with_prior,
            "crlb_pole_deg": pole_bound(c),
            "nonlinearity": findings.nonlinearity,
            "unobservable": [
                {
                    "words": t.words,
                    "combination": _combination(c.unknowns.names, t.combination),
                    "information_over_prior": t.information,
                    "exact": t.exact,
                }
                for t in findings.trades
            ],
        },
        "map": {
            "t": curve.t[i],
            "sun_body": m.sun_body[i],
            "obs_body": m.obs_body[i],
            "best_obs_body": directions[best],
            "best_information": information[best],
        },
        "plan": None if findings.plan is None else _plan(findings.plan, findings.measured),
    }


def _combination(names: tuple[str, ...], values: Floats) -> dict[str, float]:
    """The parts of a combination that exceed rounding errors."""
    least = 1e-6 * float(np.max(np.abs(values)))
    return {n: float(v) for n, v in zip(names, values, strict=True) if abs(v) > least}


def _plan(plan: Plan, measured: Measurements) -> dict[str, Any]:
    return {
        "target": plan.target.name,
        "unit": plan.target.unit,
        "criterion": plan.criterion,
        "n_candidates": len(plan.visits),
        "schedule": schedule(plan, measured),
        "sd_before": plan.schedule.sd[0],
        "sd_after": plan.schedule.sd[-1],
        "sd_after_even": plan.even.sd[-1],
        "even_visits_for_the_same": plan.even_needed,
        "sd_after_one_site": {name: s.sd[-1] for name, s in plan.sites.items()},
    }


def schedule(plan: Plan, measured: Measurements) -> list[dict[str, Any]]:
    """The visits in the order of the schedule, with the columns of ``tables/schedule.csv``."""
    curve, out = measured.curve, []
    for rank, (visit, gain, sd) in enumerate(
        zip(plan.schedule.visits, plan.schedule.gain, plan.schedule.sd[1:], strict=True), 1
    ):
        rows = plan.visits[visit]
        first = rows[0]
        values = (
            rank,
            utc(curve.epoch_jd, float(curve.t[first])),
            float(curve.t[first]),
            str(curve.site[first]),
            float(curve.t[rows[-1]] - curve.t[first]),
            len(rows),
            None if curve.range_km is None else float(curve.range_km[first]),
            float(np.degrees(curve.phase_angle[first])),
            float(np.mean(measured.mag[rows])),
            float(gain),
            float(sd),
        )
        out.append(dict(zip(COLUMNS, values, strict=True)))
    return out


def utc(epoch_jd: float | None, t: float) -> str:
    """ISO 8601 to a tenth of a second; "" if the times are not absolute."""
    if epoch_jd is None:
        return ""
    moment = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(days=epoch_jd - 2440587.5, seconds=t)
    moment += timedelta(milliseconds=50)
    return f"{moment:%Y-%m-%dT%H:%M:%S}.{moment.microsecond // 100_000}Z"


def words(findings: Findings) -> list[str]:
    """The results as lines of text, starting with the unconstrained combinations."""
    m, c = findings.measured, findings.campaign
    curve, i = m.curve, findings.most_informative
    lines = [f"note: {note}" for note in findings.notes]
    lines.append(f"{curve.n_obs} measurements: {headline(findings).lower()}")
    said = sentences(findings.trades)
    lines += [f"  {line}" for line in said[:12]]
    if len(said) > 12:
        lines.append(f"  and {len(said) - 12} more, in observability.json")
    lines.append(
        f"most informative for the attitude: t = {curve.t[i]:.1f} s"
        + (f" ({curve.site[i]})" if curve.site[i] else "")
        + f", known about one axis to {np.degrees(m.information[i] ** -0.5):.2g} deg"
    )
    lines += bound_words(c)
    lines.append(linearity_words(findings))
    if findings.plan is not None:
        lines += plan_words(findings.plan)
    return lines


def headline(findings: Findings) -> str:
    """Sentence on the number of unconstrained combinations of the unknowns."""
    unknown, left = len(findings.campaign.unknowns.parameters), len(findings.trades)
    if not left:
        return f"All of the {unknown} unknowns are seen"
    some, stay = ("One combination", "stays") if left == 1 else (f"{left} combinations", "stay")
    exact = sum(t.exact for t in findings.trades)
    how = f", {exact} of them whatever the noise" if exact else ""
    if exact == left:
        how = " whatever the noise"
    return f"{some} of the {unknown} unknowns {stay} open{how}"


def linearity_words(findings: Findings) -> str:
    """Sentence on whether the bound describes the errors, with the unknowns for which it fails.

    It covers the unknowns that the data constrain; the others have only the width of the prior.
    """
    parameters = findings.campaign.unknowns.parameters
    off = np.where(np.isfinite(findings.campaign.bound), findings.nonlinearity, -1.0)
    bent = np.flatnonzero(off > MAX_NONLINEARITY)
    seen = int(np.sum(off >= 0.0))
    if not seen:
        return "no unknown is set by the measurements alone"
    if not len(bent):
        share = max(1.0, float(np.ceil(100.0 * off.max())))
        return (
            "the brightness is linear within two standard deviations of every unknown that the "
            f"measurements set: intervals from the bounds are right to {share:.0f} %"
        )
    worst = bent[np.argsort(-off[bent])][:3]
    texts = [
        f"{parameters[i].words} ({100.0 * off[i]:.0f} %)"
        if off[i] < 1.0
        else f"{parameters[i].words} (more than their length)"
        for i in worst
    ]
    return (
        f"the bound is rough for {len(bent)} of the {seen} unknowns that the measurements set: the "
        "brightness is not linear within two standard deviations, and intervals are off, most "
        f"for {join_words(texts)}"
    )


def sentences(trades: list[Trade]) -> list[str]:
    """Sentences on unconstrained combinations, each with the number of combinations it covers."""
    counted = Counter(t.words for t in trades)
    return [words if n == 1 else f"{words} ({n} combinations)" for words, n in counted.items()]


def bound_words(c: Campaign) -> list[str]:
    """Text with the smallest and largest finite bound of each group, and the bound on the pole.

    The bounds of a group are ranked relative to the prior widths.
    """
    bound, share, lines = c.bound, c.bound / c.unknowns.prior_sd, []
    for group in dict.fromkeys(p.group for p in c.unknowns.parameters):
        rows = [r for r in c.unknowns.rows(group) if np.isfinite(bound[r])]
        if not rows:
            continue
        said = [
            _bound(c.unknowns.parameters[r], float(bound[r]))
            for r in (min(rows, key=share.__getitem__), max(rows, key=share.__getitem__))
        ]
        both = f"best {said[0]}, worst {said[1]}"
        lines.append(f"bound of {group}: {said[0] if len(rows) == 1 else both}")
    pole = pole_bound(c)
    if pole is not None:
        texts = [f"{name} {sd:.3g} deg" for name, sd in pole.items() if sd is not None]
        lines += [f"bound of the pole: {', '.join(texts)}"] if texts else []
    return lines


def _bound(p: Parameter, sd: float) -> str:
    if p.unit == "1":
        return f"{sd:.3g} ({p.words}{', relative' if 'log_' in p.name else ''})"
    unit, scale = ("deg", np.degrees(1.0)) if p.unit == "rad" else (p.unit, 1.0)
    return f"{sd * scale:.3g} {unit} ({p.words})"


def pole_bound(c: Campaign) -> dict[str, float | None] | None:
    """Bound (deg) on longitude σ_east/cos β and latitude σ_north of the pole at latitude β.

    A bound is None if the data do not constrain the coordinate. That on longitude is also None
    above one radian, because near ±90° it does not describe the error of the direction. The result
    is None if the pole is not an unknown.
    """
    law, names = c.unknowns.scenario.attitude, c.unknowns.names
    if not isinstance(law, PrincipalAxis) or "pole_east" not in names:
        return None
    east, north = (c.bound[names.index(f"pole_{direction}")] for direction in ("east", "north"))
    circle = np.cos(np.radians(law.pole_lat_deg))
    return {
        "longitude": float(np.degrees(east / circle)) if east < circle else None,
        "latitude": float(np.degrees(north)) if np.isfinite(north) else None,
    }


def plan_words(plan: Plan) -> list[str]:
    """The gain of the schedule, as lines of text."""
    unit = "" if plan.target.unit == "1" else f" {plan.target.unit}"
    before, after = plan.schedule.sd[0], plan.schedule.sd[-1]
    n = len(plan.schedule.visits)
    lines = [
        f"plan: {n} of {len(plan.visits)} possible visits take the error of {plan.target.name} "
        f"from {before:.3g}{unit} to {after:.3g}{unit}; as many at equal steps leave "
        f"{plan.even.sd[-1]:.3g}{unit}"
        + (f", {plan.even_needed} are needed for the same" if plan.even_needed else "")
    ]
    for name, alone in plan.sites.items():
        lines.append(
            f"{name} alone, {len(alone.visits)} visits: {alone.sd[-1]:.3g}{unit} "
            f"({alone.sd[-1] / after:.2f} times the error of all sites)"
        )
    return lines
