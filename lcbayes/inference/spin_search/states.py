"""States of the arcs from cells of spin, and the spins that a state stands for."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lcbayes.inference.spin_search.bodies import States
from lcbayes.inference.spin_search.cells import Cells, Grid

Floats = NDArray[np.float64]

SAME_POLE = np.cos(np.radians(12.0))
SAME_RATE = 1.5  # rad over an arc
SAME_PHASE = 1.1  # rad
ALIAS_STEP = 0.3  # rad over the time base
UNIT_STEP = 0.25  # rad, of the phase by a drift
SAME_DRIFT = 0.6  # prior sd
REACH = 30.0  # sd of the rate: the free body is on a grid, whose errors exceed the noise


def representatives(
    grid: Grid, cells: Cells, most: int, span: float | None = None
) -> NDArray[np.int64]:
    """Rows of cells, best first, no two of which belong to one state.

    Rates are distinguished over a time span (s), by default that of an arc.
    """
    span = grid.arcs.duration if span is None else span
    middle = np.asarray(grid.arcs.middle)
    phases = grid.drift.phase(cells.rate, cells.drift, middle)
    turn = np.exp(1j * (phases - phases[:, :1]))
    poles = grid.poles[cells.pole]
    left = np.ones(cells.rate.size, bool)
    chosen = []
    while left.any() and len(chosen) < most:
        i = int(np.argmax(left))  # cells are in order
        chosen.append(i)
        near = left & (poles @ poles[i] > SAME_POLE)
        near &= np.abs(cells.rate - cells.rate[i]) * span < SAME_RATE
        rows = np.flatnonzero(near)
        apart = np.abs(np.angle(turn[rows] * np.conj(turn[i])))
        left[rows[apart.max(axis=1) < SAME_PHASE]] = False
        left[i] = False
    return np.array(chosen)


def distinct(states: States, span: float, most: int) -> NDArray[np.int64]:
    """Rows of states, best first, none of which has pole, rate and phases of a better one.

    Parameters
    ----------
    states : States
        The best first.
    span : float
        Time (s) over which rates are distinguished.
    most : int
    """
    chosen: list[int] = []
    for i in range(states.rate.size):
        if len(chosen) == most:
            break
        kept = np.array(chosen, int)
        near = states.pole[kept] @ states.pole[i] > np.cos(np.radians(2.0))
        near &= np.abs(states.rate[kept] - states.rate[i]) * span < 0.3
        gap = states.phase[kept] - states.phase[i]
        gap = np.abs(np.angle(np.exp(1j * (gap - gap[:, :1]))))
        if not np.any(near & (gap.max(axis=1, initial=0.0) < 0.2)):
            chosen.append(i)
    return np.array(chosen)


def spins(grid: Grid, states: States, i: int, most: int) -> tuple[Floats, Floats, Floats]:
    """Spins near state i: rates (k,) rad/s, drifts (k,) in their sd, and phases (k,) at t = 0.

    Those of the least loss of χ², which is quadratic in the differences of rate and phases from
    those of the state, with the prior of the drift.
    """
    units = grid.drift.units(UNIT_STEP)
    found = [_spins(grid, states, i, most, unit) for unit in units]
    unit = np.repeat(units, [len(f[0]) for f in found])
    loss, rate, phase = (np.concatenate(x) for x in zip(*found, strict=True))
    span = float(grid.arcs.span[-1])
    chosen: list[int] = []
    for row in np.argsort(loss + unit**2, kind="stable"):
        apart = np.abs(unit[chosen] - unit[row])
        near = (apart > 0.0) & (apart < SAME_DRIFT)  # one minimum, seen at several drifts
        if not np.any(near & (np.abs(rate[chosen] - rate[row]) * span < SAME_RATE)):
            chosen.append(int(row))
        if len(chosen) == most:
            break
    return rate[chosen], unit[chosen], phase[chosen]


def _spins(
    grid: Grid, states: States, i: int, most: int, unit: float
) -> tuple[Floats, Floats, Floats]:
    """Losses (k,) of χ², rates (k,) rad/s and phases (k,) at t = 0, for one drift."""
    middle = np.asarray(grid.arcs.middle)
    span = float(grid.arcs.span[-1])
    q = states.information[i]
    # The common phase is free: only phases relative to their best mean count.
    one = np.ones(middle.size)
    total = max(one @ q[1:, 1:] @ one, 1e-300)
    reach = min(REACH * _width(q, one, total), grid.coarse_step) + 2.0 / span
    rate = np.abs(states.rate[i] + np.arange(-reach, reach, ALIAS_STEP / span))
    phases = grid.drift.phase(rate, np.full(rate.size, unit), middle)
    gap = np.angle(np.exp(1j * (phases - states.phase[i])))
    mean = np.angle(np.mean(np.exp(1j * gap), axis=1))  # of phases, which wrap
    gap = np.angle(np.exp(1j * (gap - mean[:, None])))
    x = np.concatenate([(rate - states.rate[i])[:, None], gap], axis=1)
    shift = -(x @ q @ np.concatenate([[0.0], one])) / total
    x[:, 1:] += shift[:, None]
    loss = np.einsum("ni,ij,nj->n", x, q, x)
    least = np.r_[True, loss[1:] <= loss[:-1]] & np.r_[loss[:-1] <= loss[1:], True]
    rows = np.flatnonzero(least)
    rows = rows[np.argsort(loss[rows])][:most]
    return loss[rows], rate[rows], shift[rows] - mean[rows]


def _width(q: Floats, one: Floats, total: float) -> float:
    """Sd of the rate (rad/s) within the arcs, all phases being free."""
    inner = q[1:, 1:] - np.outer(q[1:, 1:] @ one, one @ q[1:, 1:]) / total
    left = q[0, 0] - q[0, 1:] @ np.linalg.pinv(inner + 1e-12 * np.eye(len(one))) @ q[1:, 0]
    return float(1.0 / np.sqrt(max(left, 1e-12)))
