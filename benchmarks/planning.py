"""Does planning pay? Fifty simulated campaigns, planned and at equal steps.

    python benchmarks/planning.py            50 campaigns of each target, into RESULTS.md

A body of three diffuse facets tumbles over two sites on the orbit of the bundled box-wing. A first
visit, 40 measurements at equal steps in the first third of the transit, is fitted; campaigns whose
first fit leaves the pole or the normal worse than 10 deg are drawn anew, as linearisation means
nothing there. The rest of the transit is then measured: at equal steps, or as planned from draws of
what the first fit knows (its Gaussian), not from the truth. Everything is fitted again for many
draws of all noise (least squares without a prior, from the truth, where a search that finds the
right solution would end), and the errors are compared: what number of planned measurements reaches
the error that 64 at equal steps leave?
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from _results import table, write_section
from numpy.typing import NDArray
from scipy.optimize import isotonic_regression

from lcbayes import scenario
from lcbayes._jax import jax, jnp
from lcbayes.observability import planning
from lcbayes.observability.parameters import Unknowns
from lcbayes.observability.targets import of_directions
from lcbayes.physics import attitude, shapes
from lcbayes.scenario import ConstantRate
from lcbayes.scenarios.epochs import epochs
from lcbayes.scenarios.viewing import Orbit

Floats = NDArray[np.float64]
CAMPAIGNS, NOISES, SEED = 50, 16, 1
FACETS, SNR, FIRST, EVEN, WORST_DEG = 3, 20.0, 40, 64, 10.0
PLANNED = (4, 8, 16, 24, 32, 48, 64)
DRAWN = 400  # of what the first fit knows
TARGETS = ("pole", "normal:0")
STEPS = 12  # of least squares
BASE = scenario.load("box-wing")


@dataclass(frozen=True)
class Setting:
    """Epochs of the transit, the same for all campaigns."""

    t: Floats
    sun: Floats
    obs: Floats
    dilution: Floats
    site: NDArray[np.str_]

    @property
    def arrays(self) -> tuple[Floats, ...]:
        return self.t, self.sun, self.obs, self.dilution

    @classmethod
    def of(cls) -> Setting:
        assert isinstance(BASE.geometry, Orbit)
        passes = tuple(replace(one, step=1.0) for one in BASE.geometry.passes)
        curve = epochs(replace(BASE.geometry, passes=passes))
        assert curve.range_km is not None
        assert curve.site is not None
        near = (curve.range_km / curve.range_km.min()) ** -2.0
        return cls(curve.t, curve.sun, curve.obs, near, curve.site)


def _axes(normals: jax.Array) -> jax.Array:
    u = jnp.cross(jnp.array([0.31, -0.2, 0.93]), normals)
    return u / jnp.linalg.norm(u, axis=1, keepdims=True)


def _unknowns(normals, areas, omega) -> Unknowns:
    """The unknowns of a body whose numbers may be traced."""
    axes: Any = _axes(normals)
    shape = shapes.Body(normals, areas, axes, ("bus",) * FACETS)
    what = replace(BASE, body=shape, attitude=ConstantRate(omega))
    return Unknowns(what, PARAMETERS)


PARAMETERS = Unknowns.of(
    replace(BASE, body=shapes.body(np.eye(3)[:FACETS], np.ones(FACETS), "bus")),
    ("spin", "normals", "areas"),
).parameters
NAMES = tuple(p.name for p in PARAMETERS)
PRIOR_SD = np.array([p.prior_sd for p in PARAMETERS])


@jax.jit
def predicted(theta, truth, t, sun, obs, dilution):
    return _unknowns(*truth).flux(theta, t, sun, obs) * dilution


@jax.jit
def slope(theta, truth, t, sun, obs, dilution):
    def flux(theta):
        return _unknowns(*truth).flux(theta, t, sun, obs) * dilution

    return jax.jacfwd(flux)(theta)


@jax.jit
def fitted(start, truth, y, weight, t, sun, obs, dilution):
    """Levenberg-Marquardt for every noise draw: y (R, T), weight 1/σ or 0 (T,); θ (R, P)."""

    def flux(theta):
        return _unknowns(*truth).flux(theta, t, sun, obs) * dilution

    def one(y):
        def cost(theta):
            return jnp.sum(((y - flux(theta)) * weight) ** 2)

        def step(_, state):
            theta, now, damping = state
            j = jax.jacfwd(flux)(theta) * weight[:, None]
            normal = j.T @ j
            diagonal = jnp.diag(jnp.diag(normal) * damping + 1e-12)
            trial = theta + jnp.linalg.solve(normal + diagonal, j.T @ ((y - flux(theta)) * weight))
            after = cost(trial)
            better = after < now
            return (
                jnp.where(better, trial, theta),
                jnp.where(better, after, now),
                jnp.where(better, 0.2 * damping, 8.0 * damping),
            )

        return jax.lax.fori_loop(0, STEPS, step, (start, cost(start), 1e-3))[0]

    return jax.vmap(one)(y)


def directions(theta, truth):
    """Unit vectors of the pole and of the first normal, (2, 3)."""
    value = dict(zip(NAMES, theta, strict=True))
    omega = truth[2] + jnp.stack([value[f"omega_{a}"] for a in "xyz"])
    n, u = truth[0][0], _axes(truth[0])[0]
    about = value["normal_0_u"] * jnp.cross(n, u) - value["normal_0_v"] * u
    turn = attitude.constant_rate(jnp.ones(1), about)[0]
    return jnp.stack([omega / jnp.linalg.norm(omega), turn @ n])


@jax.jit
def errors(theta, truth):
    """Angles (deg) between estimate and truth of pole and first normal, (2,)."""
    found, true = directions(theta, truth), directions(jnp.zeros(len(NAMES)), truth)
    across = jnp.linalg.norm(jnp.cross(found, true), axis=1)
    return jnp.degrees(jnp.arctan2(across, jnp.sum(found * true, axis=1)))


_all_directions = jax.jit(jax.vmap(directions, in_axes=(0, None)))
_all_predicted = jax.jit(jax.vmap(predicted, in_axes=(0, None, None, None, None, None)))
_all_errors = jax.jit(jax.vmap(errors, in_axes=(0, None)))


def drawn(setting: Setting, rng: np.random.Generator):
    """A body, its spin, the noise, and the first fit; drawn anew until that is good enough."""
    first_third = np.flatnonzero(setting.t < setting.t[0] + np.ptp(setting.t) / 3.0)
    first = first_third[planning.even(len(first_third), FIRST)]
    arrays = setting.arrays
    while True:
        normals = rng.standard_normal((FACETS, 3))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        omega = rng.standard_normal(3)
        omega *= rng.uniform(0.01, 0.04) / np.linalg.norm(omega)
        truth = (normals, 2.0 * rng.lognormal(0.0, 0.3, FACETS), omega)
        truth = tuple(map(jnp.asarray, truth))
        zero = jnp.zeros(3 + 3 * FACETS)
        clean = np.asarray(predicted(zero, truth, *arrays))
        if not clean[first].any():
            continue
        sigma = float(clean.mean()) / SNR
        weight = np.zeros(len(clean))
        weight[first] = 1.0 / sigma
        j = np.asarray(slope(zero, truth, *arrays)) * weight[:, None]
        values = np.linalg.svd(j / np.maximum(np.linalg.norm(j, axis=0), 1e-12), compute_uv=False)
        if values[-1] < 1e-3:
            continue
        y = clean + sigma * rng.standard_normal(len(clean))
        estimate = fitted(zero, truth, y[None], weight, *arrays)[0]
        off = np.asarray(errors(estimate, truth))
        j = np.asarray(slope(estimate, truth, *arrays)) / sigma
        covariance = np.linalg.inv(j[first].T @ j[first] + np.diag(PRIOR_SD**-2))
        spread = np.degrees(np.sqrt(np.diag(covariance)))
        tilts = [NAMES.index(f"normal_0_{k}") for k in "uv"]
        rate = np.linalg.norm(omega)
        pole = np.linalg.norm([spread[NAMES.index(f"omega_{a}")] / rate for a in "xyz"])
        if max(off.max(), pole, spread[tilts].max()) < WORST_DEG:
            return truth, clean, sigma, first, estimate, covariance


def campaign(setting: Setting, seed: int) -> dict[str, dict[str, Any]]:
    """Median errors (deg) by target: after the first visit, after even ones, and as planned."""
    rng = np.random.default_rng([SEED, seed])
    truth, clean, sigma, first, estimate, covariance = drawn(setting, rng)
    rest = np.flatnonzero(setting.t > setting.t[0] + np.ptp(setting.t) / 3.0)
    known = rng.multivariate_normal(np.asarray(estimate), covariance, DRAWN)
    flux = np.asarray(_all_predicted(jnp.asarray(known), truth, *(x[rest] for x in setting.arrays)))
    apart = (flux - flux.mean(axis=0)).T / sigma / np.sqrt(DRAWN - 1)
    noise = sigma * rng.standard_normal((NOISES, len(clean)))

    def error(chosen: NDArray[np.intp]) -> Floats:
        """Of both targets, all noise drawn anew; epochs not used fill up to one size."""
        used = np.concatenate([first, rest[chosen]])
        rows = np.concatenate([used, np.zeros(FIRST + EVEN - len(used), int)])
        weight = np.where(np.arange(len(rows)) < len(used), 1.0 / sigma, 0.0)
        y = (clean + noise)[:, rows]
        theta = fitted(jnp.zeros(len(NAMES)), truth, y, weight, *(x[rows] for x in setting.arrays))
        off = np.asarray(_all_errors(theta, truth))
        return np.median(off, axis=0)

    start, even = error(np.array([], int)), error(planning.even(len(rest), EVEN))
    found = {}
    for k, target in enumerate(TARGETS):
        drawn_directions = np.asarray(_all_directions(jnp.asarray(known), truth))[:, k]
        wanted = of_directions(drawn_directions) / np.sqrt(DRAWN - 1)
        measured, wanted = planning.linearised(apart, wanted, known)
        measured = measured[:, None, :]
        chosen = [planning.best(measured, wanted, n).visits for n in PLANNED]
        found[target] = {
            "first": start[k], "even": even[k],
            "planned": np.array([error(visits)[k] for visits in chosen]),
            "second site": _second_site(setting, rest, measured, wanted),
        }  # fmt: skip
    return found


def _second_site(setting: Setting, rest, measured, wanted) -> float:
    """Bound on the error with 32 visits planned: the better site alone, over both."""
    alone = [
        planning.best(measured[setting.site[rest] == name], wanted, 32).sd[-1]
        for name in np.unique(setting.site[rest])
    ]
    return float(min(alone) / planning.best(measured, wanted, 32).sd[-1])


def needed(found: dict[str, Any]) -> float:
    """Planned measurements that reach an error; ∞ if none of those tried.

    The errors tried, each of few noise draws, are first made to fall with their number (least
    squares of the logarithm), then interpolated.
    """
    given = found["even"]
    best = np.exp(isotonic_regression(np.log(found["planned"]), increasing=False).x)
    reached = np.flatnonzero(best <= given)
    if not len(reached):
        return np.inf
    i = int(reached[0])
    if i == 0:
        return float(PLANNED[0])
    share = np.log(best[i - 1] / given) / np.log(best[i - 1] / best[i])
    return PLANNED[i - 1] + share * (PLANNED[i] - PLANNED[i - 1])


def _quartiles(x: Floats) -> str:
    low, middle, high = np.quantile(x, [0.25, 0.5, 0.75], method="nearest")
    return f"{middle:.2f} ({low:.2f} … {high:.2f})"


def main() -> None:
    setting = Setting.of()
    begun, done = time.monotonic(), []
    for seed in range(CAMPAIGNS):
        done.append(campaign(setting, seed))
        said = [f"{x['first']:.3g} {x['even']:.3g} {needed(x):.3g}" for x in done[-1].values()]
        print(seed, f"{time.monotonic() - begun:.0f} s", *said, sep="; ", flush=True)
    write(done)


def write(done: list[dict[str, dict[str, Any]]]) -> None:
    """The section of RESULTS.md."""
    rows = []
    for target in TARGETS:
        mine = [d[target] for d in done]
        count = np.array([needed(x) for x in mine]) / EVEN
        even = np.array([x["even"] for x in mine])
        same = np.array([x["planned"][-1] for x in mine]) / even
        first = np.array([x["first"] for x in mine])
        rows.append([
            target, f"{np.median(first):.2f}", f"{np.median(even):.3f}", _quartiles(count),
            f"{int(np.sum(count <= 0.5))} of {len(count)}", f"{np.median(same):.2f}",
            _quartiles(np.array([x["second site"] for x in mine])),
        ])  # fmt: skip
        print(rows[-1], flush=True)
    heads = [
        "target", "error after the first visit (deg)", f"after {EVEN} more at equal steps (deg)",
        f"planned measurements for the same error, over {EVEN}: median (quartiles)",
        "campaigns with at most half", f"error of {EVEN} planned over {EVEN} even, median",
        "bound with the better site alone over both sites, 32 planned: median (quartiles)",
    ]  # fmt: skip
    text = (
        f"{len(done)} campaigns, {FACETS} diffuse facets, SNR {SNR:g}, {NOISES} noise draws each, "
        "medians over campaigns. Errors are median angles between least-squares fits and truth.\n\n"
        + table(heads, rows)
    )
    write_section("Planned and even schedules", "python benchmarks/planning.py", text)


if __name__ == "__main__":
    main()
