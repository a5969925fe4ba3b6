"""The third step: how many turns the body makes between arcs."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.progress import Silent
from lcbayes.core.threads import threads
from lcbayes.inference import search
from lcbayes.inference.body_search.phases import Separate, rows, turned
from lcbayes.inference.search import SearchState
from lcbayes.inference.spin_search.allowed import Allowed
from lcbayes.inference.spin_search.drift import SITE, Drift
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem, compiled, lit_at, with_lit

Floats = NDArray[np.float64]

ENDS = 12  # optima of free phases that are continued
RATES = 8  # of each optimum, with whole turns, and as many with half turns
WIDEST = 4.0  # standard deviations of the rate and of its drift
SPACING = 0.25  # rad: spacing of rates times the time base
MOST = 200_000  # rates that are compared, and three times as many with their drifts
PHASE_SD = 0.02  # rad, below which a phase is not trusted
ROUNDS = ((1.0, 12, 0.3), (1.0, 25, 0.4), (1.0, 150, 1.0))
SAME = 1e-6  # relative difference of the potential below which a body looks the same
HELD, HELD_STEPS = 4, 20  # times that shadows are moved, and steps after each
FAR = 200.0  # nats above the best, beyond which a point is not moved again
REFINED = 12  # end points to which they are added


def starts(
    problem: Problem,
    separate: Separate,
    ends: SearchState,
    allowed: Allowed,
    drift: Drift,
) -> list[dict[str, Any]]:
    """Sites of motions that agree with the phases of each arc at the best optima."""
    made: list[dict[str, Any]] = []
    for row in search.different(ends, ENDS):
        made += joined(problem, separate, np.asarray(ends.z[row]), allowed, drift)
    return made


def joined(
    problem: Problem,
    separate: Separate,
    z: Floats,
    allowed: Allowed,
    drift: Drift,
) -> Iterator[dict[str, Any]]:
    """Sites of motions that agree with the phases of each arc at an optimum (D,).

    Half turns are tried as well as whole ones, because many bodies look nearly the same after them.
    """
    known = {k: np.asarray(v) for k, v in compiled(problem.constrain)(z, separate.exact).items()}
    sites = {name: known[name] for name in problem.names}
    late = separate.late(sites.pop("clock_offset_unit", np.zeros(1)))
    omega, middle = known["omega"], separate.middle
    rate = float(np.linalg.norm(omega))
    phase = rate * (late - late[0])[: len(middle)]
    since = middle - drift.middle
    (bend,) = drift.bend(np.array([rate]), since)
    for new, unit in _rates(problem, separate, z, allowed, phase, rate, bend):
        apart = phase - new * (since - since[0]) - unit * (bend - bend[0])
        apart = (apart + 0.5 * np.pi) % np.pi - 0.5 * np.pi
        at_middle = -new * since[0] - unit * bend[0] + apart.mean()
        moved = turned(sites, Rotation.from_rotvec(at_middle * omega / rate))
        for name in {"rate_unit", "omega_unit"} & moved.keys():
            moved[name] = moved[name] * new / rate
        yield moved | ({SITE: np.asarray(unit)} if drift.sd else {})


def _rates(
    problem: Problem,
    separate: Separate,
    z: Floats,
    allowed: Allowed,
    phase: Floats,
    rate: float,
    bend: Floats,
) -> list[tuple[float, float]]:
    """Rates (rad/s), and drifts in their prior sd, that lead from one phase (A,) to the next.

    Rates and drifts on a grid give the numbers of turns between arcs; for each set of numbers, rate
    and drift follow by least squares. ``bend`` (A,) is the phase by a drift of one sd.
    """
    # The phases are followed without regard to the rates that are allowed.
    nearest = float(_nearest(np.array([rate]), allowed)[0])
    if not separate.several:
        return [(rate if allowed.everything else nearest, 0.0)]
    apart, middle = phase[1:] - phase[0], separate.middle
    covariance = np.asarray(_covariance(problem, separate.exact, jnp.asarray(z)))
    covariance = covariance + np.diag([1e-16, *np.full(len(apart), PHASE_SD**2)])
    weight = np.linalg.inv(covariance)
    span = float(np.ptp(middle))
    reach = max(WIDEST * np.sqrt(covariance[0, 0]), 2.0 * np.pi / span)
    n = min(int(np.ceil(reach * span / SPACING)), MOST // 2)
    m = min(int(np.ceil(WIDEST * np.ptp(bend) / SPACING)), MOST // (2 * n + 1))
    rates = rate + np.linspace(-reach, reach, 2 * n + 1)
    rates = rates[(rates > 0.0) & allowed.rates(rates)]
    units = np.arange(-m, m + 1) * WIDEST / max(m, 1)
    grid = np.stack(np.meshgrid(rates, units), axis=-1).reshape(-1, 2)
    columns = np.array([middle[1:] - middle[0], bend[1:] - bend[0]])
    design = np.vstack([[1.0, 0.0], columns.T])
    prior = np.diag([0.0, 1.0])
    solve = np.linalg.solve(design.T @ weight @ design + prior, design.T @ weight)
    chosen: list[tuple[float, float]] = []
    for period in (2.0 * np.pi, np.pi):
        turns = np.unique(np.rint((apart - grid @ columns) / period), axis=0)
        known = np.column_stack([np.full(len(turns), rate), apart - period * turns])
        fitted = known @ solve.T
        away = fitted @ design.T - known
        cost = np.einsum("na,ab,nb->n", away, weight, away) + fitted[:, 1] ** 2
        moved = _nearest(fitted[:, 0], allowed)
        inside = [i for i in np.argsort(cost) if abs(moved[i] - fitted[i, 0]) * span < 1.0]
        for i in inside[:RATES]:
            new, unit = float(moved[i]), float(fitted[i, 1])
            far = (max(abs(new - r) * span, abs(unit - u) * np.ptp(bend)) > 1.0 for r, u in chosen)
            if all(far):
                chosen.append((new, unit))
    return chosen or [(nearest, 0.0)]


def _nearest(rates: Floats, allowed: Allowed) -> Floats:
    """The nearest allowed rate to each of some (n,)."""
    clipped = np.array([np.clip(rates, *r) for r in allowed.ranges])
    return clipped[np.argmin(np.abs(clipped - rates), axis=0), np.arange(len(rates))]


@partial(jax.jit, static_argnums=0)
def _covariance(problem: Problem, data: Epochs, z: jax.Array) -> jax.Array:
    """Of the rate (rad/s) and of the phase (rad) of each arc after the first, near an optimum.

    A coordinate at the end of its range may have no information at all, and no part in these.
    """

    def known(z: jax.Array) -> jax.Array:
        sites = problem.constrain(z, data)
        rate = jnp.linalg.norm(sites["omega"])
        late = sites["clock_offset"]
        return jnp.concatenate([rate[None], rate * (late[1:] - late[0])])

    fisher = problem.fisher(z, data)
    scale = jnp.sqrt(jnp.diag(fisher))
    scale = jnp.where(scale > 0.0, scale, 1.0)
    slopes = jax.jacfwd(known)(z) / scale
    return slopes @ jnp.linalg.pinv(fisher / jnp.outer(scale, scale), hermitian=True) @ slopes.T


def optimised(
    problem: Problem,
    data: Epochs,
    points: list[dict[str, Any]],
    workers: int,
    progress: Silent,
) -> SearchState:
    """Optima of the posterior from sites; those that are missing are prior means."""
    return search.successive_halving(
        problem, data, rows(problem, data, points), workers, progress, rounds=ROUNDS
    )


def with_fixed_shadows(
    problem: Problem,
    data: Epochs,
    ends: SearchState,
    images: Callable[[Floats], Floats],
    workers: int,
    progress: Silent,
) -> SearchState:
    """The best end points for a coarser body without shadows, near optima of the posterior.

    ``images`` (n, D) -> (n, K, D) are equivalent without shadows, and half a turn is nearly so for
    many bodies. The shadows of a point are fixed while it is moved, a few times, unless the point
    is then far above the best.
    """
    near = np.concatenate(images(np.asarray(ends.z)[search.different(ends, REFINED)]))
    potential = compiled(problem.potential)
    half = np.asarray(rows(problem, data, [_half_turned(problem, data, z) for z in near]))
    before, after = (np.array([float(potential(z, data)) for z in x]) for x in (near, half))
    near = np.concatenate([near, half[np.abs(after - before) > SAME * np.abs(before)]])

    def moved(row: SearchState) -> SearchState:
        if row.potential[0] <= best + FAR:
            start, lit = search.init(row.z, 1e-3), lit_at(problem, row.z[0], data)
            held = data if lit is None else with_lit(data, lit.fixed)
            row = search.advance(problem, held, start, HELD_STEPS)
            row = row._replace(potential=potential(row.z[0], data)[None])
        track.advance(HELD_STEPS)
        return row

    state = [search.init(z[None]) for z in near]
    total = len(state) * HELD * HELD_STEPS
    with progress.stage("adding shadows", total, "steps") as track, threads(workers) as pool:
        for _ in range(HELD):
            best = float(np.nanmin([row.potential[0] for row in state]))
            state = list(pool.map(moved, state))
    return search.joined(*state)


def _half_turned(problem: Problem, data: Epochs, z: Floats) -> dict[str, Any]:
    """Sites of a point (D,) with the body turned by 180° about ω."""
    sites = {k: np.asarray(v) for k, v in compiled(problem.constrain)(z, data).items()}
    omega = sites["omega"]
    turn = Rotation.from_rotvec(np.pi * omega / np.linalg.norm(omega))
    return turned({name: sites[name] for name in problem.names}, turn)
