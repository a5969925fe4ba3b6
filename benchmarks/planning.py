"""The benefit of planning: fifty simulated campaigns, planned and at equal steps.

    python benchmarks/planning.py evening     4.5 hours of a high satellite, into RESULTS.md
    python benchmarks/planning.py transit     six minutes of a low one

A body of three diffuse facets tumbles on an orbit seen from two sites. A first visit, 40
measurements at equal steps in the first part of the window, is fitted. The rest of the window is
then measured 64 times at equal steps, or at most as often by a plan. All planned measurements are
chosen from draws of the fit's posterior; those of the next third of the window are taken and
fitted; the remaining ones are planned again, and so on. A plan does not use the truth. Only the
first fit starts there, where a search that finds the right solution would end. Every fit has
several starts. The last fit of each schedule, even or planned, measures its error and also starts
at the truth; the best fit is used. The result is the number of planned measurements with the same
error as 64 at equal steps. A campaign is drawn again if the bound on pole or normal after its first
visit exceeds 10 deg.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Any

import numpy as np
from _results import table, write_section
from numpy.typing import NDArray
from scipy.optimize import isotonic_regression

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.levenberg_marquardt import levenberg_marquardt, of_residuals
from lcbayes.geometry.tle import parse_tle
from lcbayes.physics.attitude import rotations
from lcbayes.physics.bodies import shapes
from lcbayes.simulation.observability import planning
from lcbayes.simulation.observability.campaign import bound
from lcbayes.simulation.observability.parameters import Unknowns
from lcbayes.simulation.observability.targets import of_sites
from lcbayes.simulation.scenarios import scenario
from lcbayes.simulation.scenarios.epochs import epochs
from lcbayes.simulation.scenarios.scenario import ConstantRate
from lcbayes.simulation.scenarios.viewing import Orbit
from lcbayes.tasks.observability.known import roots

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]
CAMPAIGNS, NOISES, SEED = 50, 4, 1
FACETS, SNR, FIRST, EVEN, WORST_DEG = 3, 20.0, 40, 64, 10.0
PLANNED = (16, 32, 64)
TARGETS = ("pole", "normal:0")
DRAWS, STARTS, STEPS = 8, 6, 50  # posterior draws; starts of each fit; least-squares steps
DRAW_STEPS = 10
BASE = scenario.load("box-wing")


@dataclass(frozen=True)
class Setting:
    """Epochs of a window, equal for all campaigns; the first visit, and the times of planning."""

    t: Floats
    sun: Floats
    obs: Floats
    dilution: Floats
    first: Rows
    plans: Floats
    rates: tuple[float, float]

    @classmethod
    def of(cls, orbit: Orbit, share: float, rates: tuple[float, float]) -> Setting:
        """``share`` of the window for the first visit; rates of the spin (rad/s)."""
        curve = epochs(orbit)
        assert curve.range_km is not None
        near = (curve.range_km / curve.range_km.min()) ** -2.0
        begin = curve.t[0] + share * np.ptp(curve.t)
        first = np.flatnonzero(curve.t < begin)
        plans = begin + (curve.t[-1] - begin) * np.arange(3) / 3.0
        return cls(
            curve.t,
            curve.sun,
            curve.obs,
            near,
            first[planning.even(len(first), FIRST)],
            plans,
            rates,
        )

    @property
    def arrays(self) -> tuple[Floats, ...]:
        return self.t, self.sun, self.obs, self.dilution


def transit() -> Setting:
    """The window of the bundled scenario: six minutes, the first third of it a first visit."""
    assert isinstance(BASE.geometry, Orbit)
    passes = tuple(replace(one, step=1.0) for one in BASE.geometry.passes)
    return Setting.of(replace(BASE.geometry, passes=passes), 1.0 / 3.0, (0.01, 0.04))


def evening() -> Setting:
    """4.5 hours of a satellite at 17,000 km altitude with a spin period of 5 to 25 minutes."""
    lines = (
        "1 99002U 26002A   26105.50000000  .00000000  00000-0  00000-0 0  999",
        "2 99002   7.0000 060.0000 0003000 090.0000   0.0000  2.50000000   12",
    )
    tle = parse_tle("\n".join(line + _checksum(line) for line in lines), "evening.tle")
    assert isinstance(BASE.geometry, Orbit)
    start, stop = datetime(2026, 4, 15, 18, 30, tzinfo=UTC), datetime(2026, 4, 16, 6, tzinfo=UTC)
    passes = tuple(
        replace(one, start=start, stop=stop, step=60.0, max_sun_elevation_deg=-12.0)
        for one in BASE.geometry.passes
    )
    return Setting.of(Orbit(tle, passes), 1.0 / 6.0, (2 * np.pi / 1500.0, 2 * np.pi / 300.0))


def _checksum(line: str) -> str:
    return str(sum(int(c) if c.isdigit() else c == "-" for c in line) % 10)


SETTINGS: dict[str, Callable[[], Setting]] = {"evening": evening, "transit": transit}


def _axes(normals: jax.Array) -> jax.Array:
    u = jnp.cross(jnp.array([0.31, -0.2, 0.93]), normals)
    return u / jnp.linalg.norm(u, axis=1, keepdims=True)


PARAMETERS = Unknowns.of(
    replace(BASE, body=shapes.body(np.eye(3)[:FACETS], np.ones(FACETS), "bus")),
    ("spin", "normals", "areas"),
).parameters
NAMES = tuple(p.name for p in PARAMETERS)
PRECISION = np.array([p.prior_sd for p in PARAMETERS]) ** -2.0


def predicted(theta, truth, arrays):
    """Flux for deviations θ from a body and a spin, which JAX may trace, (T,)."""
    normals, areas, omega = truth
    t, sun, obs, dilution = arrays
    axes: Any = _axes(normals)
    body = shapes.Body(normals, areas, axes, ("bus",) * FACETS)
    what = replace(BASE, body=body, attitude=ConstantRate(omega))
    return Unknowns(what, PARAMETERS).flux(theta, t, sun, obs) * dilution


def directions(theta, truth):
    """Unit vectors of the pole and of the first normal, (2, 3)."""
    value = dict(zip(NAMES, theta, strict=True))
    omega = truth[2] + jnp.stack([value[f"omega_{a}"] for a in "xyz"])
    n, u = truth[0][0], _axes(truth[0])[0]
    about = value["normal_0_u"] * jnp.cross(n, u) - value["normal_0_v"] * u
    turn = rotations.constant_rate(jnp.ones(1), about)[0]
    return jnp.stack([omega / jnp.linalg.norm(omega), turn @ n])


def tangents(theta, truth):
    """Components of the two targets: angles perpendicular to the two directions, deg, (2, 2)."""
    pole, normal = directions(theta, truth)
    sites = {"omega": pole, "normals": normal[None]}
    return jnp.stack([of_sites(sites, name)[0] for name in TARGETS])


def least_squares(residuals, start, steps):
    """Levenberg–Marquardt: the final point, and half the sum of squares there."""
    end = levenberg_marquardt(
        of_residuals(residuals), start, num_steps=steps, tolerance=0.0, damping=1e-3
    )
    return end.position, end.model.value


@jax.jit
def fitted(starts, truth, y, weight, rows, arrays, key):
    """For every noise realisation: the best fit from its starts, and posterior draws.

    starts (R, S, P), y, weight and rows (R, n); θ (R, P) and draws (R, K, P). A draw is the best
    fit to data and prior perturbed by their uncertainties (randomised maximum likelihood), with a
    wide prior centred on the fit.
    """

    def one(starts, y, weight, rows, key):
        some = tuple(x[rows] for x in arrays)

        def residuals(theta):
            return (predicted(theta, truth, some) - y) * weight

        ends, costs = jax.vmap(lambda s: least_squares(residuals, s, STEPS))(starts)
        best = ends[jnp.argmin(costs)]

        def draw(key):
            noise = jax.random.normal(key, (len(y) + len(best),))
            wide = jnp.sqrt(PRECISION)

            def disturbed(theta):
                r = residuals(theta) + noise[: len(y)] * (weight > 0.0)
                return jnp.concatenate([r, (theta - best) * wide + noise[len(y) :]])

            return least_squares(disturbed, best, DRAW_STEPS)[0]

        return best, jax.vmap(draw)(jax.random.split(key, DRAWS))

    return jax.vmap(one)(starts, y, weight, rows, jax.random.split(key, len(y)))


_slopes = jax.jit(jax.vmap(jax.jacfwd(predicted), in_axes=(0, None, None)))
_target_slopes = jax.jit(jax.vmap(jax.jacfwd(tangents), in_axes=(0, None)))


@jax.jit
def errors(theta, truth):
    """Angles (deg) between estimates (R, P) and truth for pole and first normal, (R, 2)."""
    true = directions(jnp.zeros(len(NAMES)), truth)
    result = jax.vmap(directions, in_axes=(0, None))(theta, truth)
    across = jnp.linalg.norm(jnp.cross(result, true), axis=-1)
    return jnp.degrees(jnp.arctan2(across, jnp.sum(result * true, axis=-1)))


class Campaign:
    """A body, its spin, the noise of all epochs, and the fits to the first visit."""

    def __init__(self, setting: Setting, seed: int) -> None:
        rng = np.random.default_rng([SEED, seed])
        self.setting, self.arrays = setting, tuple(map(jnp.asarray, setting.arrays))
        self.key = jax.random.key(seed)
        zero = jnp.zeros(len(NAMES))
        while True:
            self.truth = _body(rng, setting.rates)
            clean = np.asarray(predicted(zero, self.truth, self.arrays))
            if not clean[setting.first].any():
                continue
            self.sigma = float(clean.mean()) / SNR
            self.slope = np.asarray(_slopes(zero[None], self.truth, self.arrays))[0] / self.sigma
            self.target = np.asarray(_target_slopes(zero[None], self.truth))[0]
            if max(self.bound(setting.first, k) for k in range(2)) < WORST_DEG:
                break
        self.y = clean + self.sigma * rng.standard_normal((NOISES, len(clean)))
        self.rest = np.flatnonzero(setting.t >= setting.plans[0])
        visited = [setting.first] * NOISES
        self.first = self.fit(jnp.zeros((NOISES, STARTS, len(NAMES))), visited)

    def bound(self, rows: Rows, k: int) -> float:
        """Bound on the error of a target with these measurements, deg; prior included."""
        seen = np.concatenate([self.slope[rows], np.diag(np.sqrt(PRECISION))])
        if not np.all(np.isfinite(bound(self.slope[rows]))):
            return np.inf
        return float(
            np.sqrt(
                np.trace(self.target[k] @ np.linalg.inv(seen.T @ seen) @ self.target[k].T) / 2.0
            )
        )

    def fit(self, starts, rows: list[Rows]) -> tuple[jax.Array, jax.Array]:
        """θ and draws from the measurements of each noise realisation, padded to one size."""
        used = np.zeros((NOISES, FIRST + EVEN), int)
        weight = np.zeros(used.shape)
        for i, mine in enumerate(rows):
            used[i, : len(mine)], weight[i, : len(mine)] = mine, 1.0 / self.sigma
        self.key, key = jax.random.split(self.key)
        y = np.take_along_axis(self.y, used, axis=1)
        return fitted(starts, self.truth, y, weight, used, self.arrays, key)

    def starts(self, theta, draws, last: bool):
        """Starts of the next fit: the last fit, some of its draws and some of the first fit's.

        The last fit of a schedule, which only measures its error, also starts at the truth, as an
        exhaustive search would; the best fit is used.
        """
        early = self.first[1][:, : STARTS - 3]
        if last:
            early = early.at[:, -1].set(0.0)
        return jnp.concatenate([theta[:, None], draws[:, :2], early], axis=1)

    def even(self) -> Floats:
        """Median error (deg) of both targets after measurements at equal steps, (2,)."""
        chosen = self.rest[planning.even(len(self.rest), EVEN)]
        rows = [np.concatenate([self.setting.first, chosen])] * NOISES
        return np.median(
            errors(self.fit(self.starts(*self.first, last=True), rows)[0], self.truth), axis=0
        )

    def planned(self, n: int, k: int) -> float:
        """Median error (deg) of one target after n planned measurements."""
        theta, draws = self.first
        rows, left = [self.setting.first] * NOISES, [n] * NOISES
        for now, then in zip(self.setting.plans, [*self.setting.plans[1:], np.inf], strict=True):
            for i in range(NOISES):
                if left[i]:
                    chosen = self._plan(draws[i], rows[i], now, left[i], k)
                    chosen = chosen[self.setting.t[chosen] < then]
                    rows[i], left[i] = np.concatenate([rows[i], chosen]), left[i] - len(chosen)
            last = np.isinf(then)
            theta, draws = self.fit(self.starts(theta, draws, last), rows)
        return float(np.median(errors(theta, self.truth)[:, k]))

    def _plan(self, draws, used: Rows, now: float, n: int, k: int) -> Rows:
        """n epochs after ``now``, planned from the current posterior draws."""
        slopes = np.asarray(_slopes(draws, self.truth, self.arrays)) / self.sigma
        seen = slopes[:, used]
        root = roots(np.swapaxes(seen, 1, 2) @ seen + np.diag(PRECISION))
        targets = np.asarray(_target_slopes(draws, self.truth))[:, k] @ root
        ahead = (self.setting.t >= now)[:, None]  # past epochs are unavailable
        measured = (slopes @ root * ahead)[:, self.rest, None]
        return self.rest[planning.best(measured, targets, n).visits]


def _body(rng: np.random.Generator, rates: tuple[float, float]):
    normals = rng.standard_normal((FACETS, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    omega = rng.standard_normal(3)
    omega *= rng.uniform(*rates) / np.linalg.norm(omega)
    areas = 2.0 * rng.lognormal(0.0, 0.3, FACETS)
    return tuple(map(jnp.asarray, (normals, areas, omega)))


def needed(even: float, planned: Floats) -> float:
    """Number of planned measurements that reaches an error; ∞ if no trial number reaches it.

    The errors come from few noise realisations. They are first fitted by a decreasing function of
    the number (least squares in the logarithm), then interpolated in logarithms.
    """
    best = isotonic_regression(np.log(planned), increasing=False).x
    reached = np.flatnonzero(best <= np.log(even))
    if not len(reached):
        return np.inf
    i = int(reached[0])
    if i == 0:
        return float(PLANNED[0])
    share = (best[i - 1] - np.log(even)) / (best[i - 1] - best[i])
    return float(PLANNED[i - 1] * (PLANNED[i] / PLANNED[i - 1]) ** share)


def _quartiles(x: Floats) -> str:
    low, middle, high = np.quantile(x, [0.25, 0.5, 0.75], method="nearest")
    return f"{middle:.2f} ({low:.2f} … {high:.2f})"


def run(setting: Setting) -> list[list[dict[str, Any]]]:
    """For each campaign and target: errors after the first visit, at equal steps, planned."""
    begun, done = time.process_time(), []
    for seed in range(CAMPAIGNS):
        campaign = Campaign(setting, seed)
        first = np.median(errors(campaign.first[0], campaign.truth), axis=0)
        even = campaign.even()
        mine = [
            {
                "first": first[k],
                "even": even[k],
                "planned": np.array([campaign.planned(n, k) for n in PLANNED]),
            }
            for k in range(len(TARGETS))
        ]
        done.append(mine)
        said = [
            f"{x['first']:.3g} {x['even']:.3g} {np.round(x['planned'], 3)} "
            f"{needed(x['even'], x['planned']):.3g}"
            for x in mine
        ]
        print(seed, f"{time.process_time() - begun:.0f} s", *said, sep="; ", flush=True)
    return done


def write(window: str, done: list[list[dict[str, Any]]]) -> None:
    """The section of RESULTS.md."""
    rows = []
    for k, target in enumerate(TARGETS):
        even = np.array([d[k]["even"] for d in done])
        planned = np.array([d[k]["planned"] for d in done])
        count = np.array([needed(d[k]["even"], d[k]["planned"]) for d in done]) / EVEN
        half = planned[:, PLANNED.index(EVEN // 2)] / even
        rows.append(
            [
                target,
                f"{np.median([d[k]['first'] for d in done]):.2f}",
                f"{np.median(even):.3f}",
                _quartiles(count),
                f"{int(np.sum(count <= 0.5))} of {len(count)}",
                f"{np.median(half):.2f}",
                f"{np.median(planned[:, -1] / even):.2f}",
            ]
        )
        print(rows[-1], flush=True)
    heads = [
        "target",
        "error after the first visit (deg)",
        f"after {EVEN} more at equal steps (deg)",
        f"planned measurements for the same error, over {EVEN}: median (quartiles)",
        "campaigns with at most half",
        f"error of {EVEN // 2} planned over {EVEN} even, median",
        f"of {EVEN} planned",
    ]
    text = (
        f"{len(done)} of {CAMPAIGNS} campaigns. {SETTINGS[window].__doc__} {FACETS} facets, "
        f"SNR {SNR:g} (mean flux over noise), {NOISES} noises each; medians over campaigns. Errors "
        "are median angles between least-squares fits and truth. Beside what is counted each "
        f"campaign has the {FIRST} measurements of its first visit. Planned were "
        f"{', '.join(map(str, PLANNED))} measurements, so no ratio is below "
        f"{PLANNED[0] / EVEN:g}.\n\n" + table(heads, rows)
    )
    title = f"Planned and even schedules: {window}"
    write_section(title, f"python benchmarks/planning.py {window}", text)


if __name__ == "__main__":
    if len(sys.argv) != 2 or sys.argv[1] not in SETTINGS:
        sys.exit(__doc__)
    write(sys.argv[1], run(SETTINGS[sys.argv[1]]()))
