"""What could be asked of a light curve: commands, conditions and rough costs."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from lcbayes.core.constants import DAY_S, HOUR_S
from lcbayes.core.text import join_words
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.attitude_scan.limits import PERIODS_H, unsuited
from lcbayes.inversion.spin.candidates import Candidates
from lcbayes.inversion.spin.sidereal import MIN_PASSES
from lcbayes.inversion.spin.windows import MIN_CYCLES
from lcbayes.tasks.commands import command

START_S = 40.0  # tracing, compiling and search of a fit
SPIN_S = 60.0  # of the search of a spin in addition
GRADIENTS = 150_000  # of a fit: 4 chains of 950 draws with some 40 gradients each
GRADIENT_S = 5e-9  # per epoch and facet, one core
BODY_S = 250.0  # of the search for the motion of a body of known parts
BODY_EPOCH_S = 2.0  # of the chains, for each epoch
SCAN_STEP_S = 1.5e-8  # per epoch and facet of a step of a hypothesis
SCAN_POLES, SCAN_STEPS, SCAN_FACETS = 12, 20, 150  # of the screening of a period
BLIND_S, BLIND_POINT_S = 60.0, 0.2  # of a scan of all usual periods, and for each point
COST = (
    f"rough, on one core: {START_S:.0f} s to compile and search, and for a fit "
    f"{GRADIENTS / 1000:.0f} thousand gradients of {GRADIENT_S * 1e9:.0f} ns per epoch and facet, "
    f"or, of a body of known parts, {BODY_S:.0f} s and {BODY_EPOCH_S:.0f} s per epoch; "
    "a spin often has several solutions, each of which costs as much again, and a body that the "
    "model does not describe may take many times longer"
)
ASTEROID_KM = 1e6  # farther objects orbit the Sun
LOW_KM = 3000.0  # ranges of low orbits
SHORT_S = 3 * DAY_S
PHASE_SPAN_DEG = 30.0  # as shape-match needs
FEWEST_PHASES = 100  # points, as shape-match needs
DENSE_S = 20.0
NEARLY = 0.9  # part of χ² explained, relative to the first period, that others need
GRID_FACETS = 500  # default of convex-grid


@dataclass(frozen=True)
class Advice:
    """One command that could be run.

    Attributes
    ----------
    command : the command line
    answers : what it determines
    suits : whether the light curve meets its known conditions
    why : the condition that is met or not
    cost_s : rough time on one core, s; NaN if the command does not suit
    """

    command: str
    answers: str
    suits: bool
    why: str
    cost_s: float


@dataclass(frozen=True)
class Known:
    """Properties of a light curve that the conditions refer to."""

    curve: LightCurve
    facts: dict[str, Any]
    period: float | None
    varies: bool  # with a period, though perhaps one too long for the passes to measure it
    cycles: float  # in the series from which the period comes
    joined: bool  # whether the period comes from nights joined
    aliases: list[float]  # other periods that explain nearly as much, s, of joined nights
    passes: int
    asteroid: bool
    low: bool
    sampled_passes: int

    @property
    def blind(self) -> bool:
        """Whether its period can be searched among all usual ones of asteroids."""
        return self._unknown and self.curve.frame == "ecliptic-j2000"

    @property
    def nameless(self) -> bool:
        """Whether that only takes axes of the ecliptic, and the file does not name its axes."""
        return self._unknown and self.curve.frame == "inertial"

    @property
    def rapid(self) -> bool:
        """Whether the period is far shorter than those usual for asteroids, so that a trend within
        the nights is the likelier cause."""
        return self.period is not None and 2.0 * self.period < PERIODS_H[0] * HOUR_S

    @property
    def _unknown(self) -> bool:
        unknown = self.period is None or self.rapid
        return self.asteroid and unknown and not unsuited(self.curve)


def advise(curve: LightCurve, facts: dict[str, Any], candidates: Candidates | None) -> list[Advice]:
    """The commands for a light curve, those that suit first."""
    known = _known(curve, facts, candidates)
    if curve.brightness_only:
        return [_geometry(known)]
    rules: tuple[Callable[[Known], Iterator[Advice]], ...] = (
        _spin,
        _scan,
        _asteroid,
        _faceted,
        _known_body,
        _stabilised,
        _attitude_test,
        _shape_match,
        _glints,
    )
    listed = [advice for rule in rules for advice in rule(known)]
    return sorted(listed, key=lambda one: not one.suits)


def _known(curve: LightCurve, facts: dict[str, Any], candidates: Candidates | None) -> Known:
    ranges = curve.range_km
    asteroid = (
        not facts["orbit"]
        and (curve.frame == "ecliptic-j2000" or facts["span_s"] > 30 * DAY_S)
        and (ranges is None or bool(np.median(ranges) > ASTEROID_KM))
    )
    period = candidates.best if candidates is not None else None
    long_passes = 0
    if candidates is not None and period is not None and not candidates.joined:
        long_passes = sum(p.length / period >= MIN_CYCLES for p in candidates.spin.passes)
    return Known(
        curve=curve,
        facts=facts,
        period=period,
        varies=candidates is not None and candidates.significant,
        cycles=0.0 if candidates is None or period is None else candidates.listed[0].cycles,
        joined=candidates is not None and candidates.joined,
        aliases=_aliases(candidates),
        passes=facts["n_passes"],
        asteroid=asteroid,
        low=ranges is not None and bool(np.median(ranges) < LOW_KM),
        sampled_passes=long_passes,
    )


def _aliases(candidates: Candidates | None) -> list[float]:
    """Periods (s) that explain nearly as much of χ² as the first one, where nights were joined."""
    if candidates is None or not candidates.joined or not candidates.significant:
        return []
    first, *others = candidates.listed
    return [c.period_s for c in others if c.explained > NEARLY * first.explained]


def fit_cost(epochs: int, facets: int) -> float:
    """Rough time of a fit on one core, s."""
    return START_S + GRADIENTS * GRADIENT_S * epochs * facets


def _geometry(known: Known) -> Advice:
    source = known.curve.source.get("file") or "CURVE"
    if known.curve.source.get("format") == "alcdef":
        line = f"lcbayes.read({source!r}, geometry=False).to_pandas()"
        why = (
            "ALCDEF holds no directions, which all other commands need: in Python, add columns "
            "sun_x .. obs_z of an ephemeris to this table, correct the times for light time, and "
            "give the table to lcbayes.read; DAMIT has many asteroids with directions"
        )
        return Advice(line, "everything else", True, why, 1.0)
    line = f"lcbayes look {shlex.quote(source)} --tle object.tle --site LAT,LON,HEIGHT"
    dated = known.curve.epoch_jd is not None
    why = (
        "the file has no directions to Sun and observer, which all other commands need; two-line "
        "elements with a site give them, or columns sun_x .. obs_z, or ra_deg dec_deg range_km"
    )
    undated = "; times in seconds need the line '# epoch_jd: …' above the header as well"
    return Advice(line, "everything else", True, why + ("" if dated else undated), 1.0)


def _spin(known: Known) -> Iterator[Advice]:
    curve = known.curve
    if known.asteroid:
        return
    need = f"{MIN_PASSES} passes of {MIN_CYCLES:.0f} cycles each are needed"
    suits = known.sampled_passes >= MIN_PASSES
    why = f"{_passes(known.sampled_passes)} of {MIN_CYCLES:.0f} cycles of the period or more"
    if known.period is None:
        why = "no period is detected"
    cost = 10.0 + 2e-8 * 199 * min(1.5 * curve.n_obs, 20_000) * curve.n_obs
    yield _advice(known, suits, "pole and sidereal period without a shape", why, need, cost, "spin")


def _asteroid(known: Known) -> Iterator[Advice]:
    if not known.asteroid:
        return
    why = "curves of a distant object over months or years"
    words = ["--model", "convex-grid"]
    if known.blind:
        words += ["--start-from", "scan"]
        why += "; after the scan, or with --period HOURS where a sidereal period is known"
    elif known.period is None:
        words += ["--period", "HOURS"]
    elif _trials(known) > 1.0:
        words += ["--start-from", "scan"]
        why += "; after the scan, because this period is not accurate enough for all of them"
    else:
        words += ["--period", f"{known.period / HOUR_S:.6g}"]
    cost = fit_cost(known.curve.n_obs, GRID_FACETS)
    answers = "pole, sidereal period and convex shape"
    yield _advice(known, True, answers, why, "", cost, "fit", *words)


def _scan(known: Known) -> Iterator[Advice]:
    if known.blind:
        yield _blind_scan(known)
        if not known.rapid:
            return
    low, high = _period_range(known)
    if known.period is None:
        hint = "FROM,TO"
    elif known.period < HOUR_S:
        hint = f"{low:.5g}s,{high:.5g}s"
    else:
        hint = f"{low / HOUR_S:.6g},{high / HOUR_S:.6g}"
    why = "no period is detected: give a range" if known.period is None else "a period is detected"
    if known.blind:
        why += ", but far shorter than those usual for asteroids: a trend within nights may give it"
    if known.nameless:
        why += (
            ", or, if the axes are those of the ecliptic J2000, say so with a first line "
            "'# frame: ecliptic-j2000', and look again: then all usual periods can be searched"
        )
    if known.aliases:
        listed = join_words(f"{period / HOUR_S:.5g} h" for period in known.aliases)
        why += f"; {listed} explain{'s' * (len(known.aliases) == 1)} nearly as much: scan there too"
    cost = np.nan
    if known.period is not None:
        steps = SCAN_POLES * SCAN_STEPS * max(1.0, _trials(known))
        cost = START_S + steps * SCAN_STEP_S * known.curve.n_obs * SCAN_FACETS
    answers = "poles and periods, each with its best body, ranked"
    yield _advice(
        known,
        known.period is not None,
        answers,
        why,
        "a range of periods is needed",
        cost,
        "scan",
        "--period-range",
        hint,
    )


def _blind_scan(known: Known) -> Advice:
    """A scan of all usual periods of asteroids, as by `lcbayes survey`."""
    found = "no usual period" if known.rapid else "no period"
    why = f"{found} is detected in single nights or adjacent ones; all of them together may show it"
    cost = BLIND_S + BLIND_POINT_S * known.curve.n_obs
    periods = ",".join(f"{hours:g}" for hours in PERIODS_H)
    words = ("--period-range", periods, "--first-stage", "periodogram")
    return _advice(
        known, True, "period, and poles with their bodies", why, "", cost, "scan", *words
    )


def _trials(known: Known) -> float:
    """Number of periods to tell apart between the ends of the range that is scanned."""
    low, high = _period_range(known)
    return 2 * known.facts["span_s"] * (1 / low - 1 / high) / 0.8


def _period_range(known: Known) -> tuple[float, float]:
    """Sidereal periods to scan, s: near the period, and up to twice it for single passes.

    Most bodies repeat their brightness twice in a rotation. For joined nights, the period is that
    of a Fourier series, which contains such repetitions.
    """
    if known.period is None:
        return np.nan, np.nan
    margin = 1.0 / max(known.cycles, 20.0)
    return (1 - margin) * known.period, (1 + margin) * known.period * (1 if known.joined else 2)


def _faceted(known: Known) -> Iterator[Advice]:
    if known.asteroid:
        return
    curve = known.curve
    words = ["--n-facets", "2"]
    if not known.varies:
        words += ["--spin", "none"]
    why = f"{known.facts['span_s'] / HOUR_S:.3g} h of data"
    need = f"the attitude of one spin must hold over at most {SHORT_S / DAY_S:.0f} days"
    suits = known.facts["span_s"] <= SHORT_S
    search = SPIN_S if known.varies else 0.0
    cost = search + fit_cost(curve.n_obs, 2)
    yield _advice(
        known, suits, "facets, spin and their uncertainty", why, need, cost, "fit", *words
    )
    cost = 2 * sum(search + fit_cost(curve.n_obs, n) for n in range(1, 5))
    words[1] = "1-4"
    yield _advice(known, suits, "the number of facets", why, need, cost, "compare", *words)


def _known_body(known: Known) -> Iterator[Advice]:
    if known.asteroid:
        return
    suits = known.varies and known.facts["span_s"] <= SHORT_S
    why = f"{known.facts['span_s'] / HOUR_S:.3g} h of data, {'a' if known.varies else 'no'} period"
    need = f"a period, and one spin over at most {SHORT_S / DAY_S:.0f} days, are needed"
    yield _advice(
        known,
        suits,
        "motion and surface of a body whose parts are known, here a bundled one (lcbayes models "
        "body lists them)",
        why,
        need,
        BODY_S + BODY_EPOCH_S * known.curve.n_obs,
        "fit",
        "--model",
        "body",
        "--body",
        "rocket-stage",
    )


def _stabilised(known: Known) -> Iterator[Advice]:
    if known.asteroid:
        return
    orbit = known.facts["orbit"]
    suits = bool(orbit and known.passes >= 5 and known.period is None)
    why = f"{_passes(known.passes)}, {'no' if known.period is None else 'a'} period"
    need = "an orbit (--tle), five passes or more, and no period of a spin are needed"
    cost = fit_cost(known.curve.n_obs, 8)
    yield _advice(
        known,
        suits,
        "surfaces of a stabilised satellite",
        why + (", orbit known" * bool(orbit)),
        need,
        cost,
        "fit",
        "--model",
        "stabilised",
    )


def _attitude_test(known: Known) -> Iterator[Advice]:
    if known.asteroid:
        return
    orbit = known.facts["orbit"]
    suits = bool(orbit and known.passes >= 3)
    why = _passes(known.passes) + (", orbit known" * bool(orbit))
    need = "an orbit (--tle) and several passes of similar geometry are needed"
    cost = 30.0 + 2e-3 * known.curve.n_obs
    yield _advice(
        known, suits, "the attitude laws that the data allow", why, need, cost, "attitude-test"
    )


def _shape_match(known: Known) -> Iterator[Advice]:
    if known.asteroid:
        return
    low, high = known.facts["phase_angle_range_deg"]
    suits = high - low >= PHASE_SPAN_DEG and known.curve.n_obs >= FEWEST_PHASES
    why = f"{known.curve.n_obs} points over {high - low:.0f}° of phase angle"
    need = f"{FEWEST_PHASES} points over {PHASE_SPAN_DEG:.0f}° are needed"
    yield _advice(
        known,
        suits,
        "which simple shapes agree with the brightness",
        why,
        need,
        30.0,
        "shape-match",
    )


def _glints(known: Known) -> Iterator[Advice]:
    cadence = known.facts["cadence_s"]
    if known.asteroid or cadence is None:
        return
    why = f"a point every {cadence:.3g} s"
    need = f"a point every {DENSE_S:.0f} s or less is needed"
    cost = 20.0 + 2e-4 * known.curve.n_obs
    suits = cadence <= DENSE_S
    yield _advice(known, suits, "directions of facets from their glints", why, need, cost, "glints")


def _passes(number: int) -> str:
    return f"{number} pass" if number == 1 else f"{number} passes"


def _advice(
    known: Known,
    suits: bool,
    answers: str,
    why: str,
    need: str,
    cost: float,
    task: str,
    *words: str,
) -> Advice:
    line = command(known.curve, task, *words)
    reason = why if suits or not need else f"{why}; {need}"
    return Advice(line, answers, suits, reason, cost if suits else np.nan)
