"""Ratios of the evidences of solutions of one form, by bridges from each to the next.

Two motions that differ by a turn between passes have posteriors of nearly the same form: what the
data determine has other values of similar widths, and what they leave open is open in both. A map
that takes the one to the other makes them overlap, where a Gaussian overlaps with neither.

References
----------
Meng & Schilling 2002, JCGS 11, 552 (warp bridge sampling).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lcbayes.data.segments import split
from lcbayes.inference.basins import evenly
from lcbayes.inference.label_switching import FacetOrder
from lcbayes.inference.modes import MAX_LEFT_OUT, Mode
from lcbayes.inference.motions import attitudes
from lcbayes.modelling.constrained import potentials
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.samplers.bridge import LogEvidence, log_ratio
from lcbayes.samplers.facet_moves import AREAS, NORMALS

Floats = NDArray[np.float64]

DRAWS = 1500  # of each solution
EFFECTIVE = 200.0  # of these, in the error
LARGEST_SE = 0.5  # nats, above which a weight is uncertain and a bridge does not hold
APART_SE = 3.0  # nats
FEWEST = 2  # ratios that show the error of Gaussian approximations
FIXED = np.cos(np.radians(10.0))  # mean resultant length above which a normal is determined
FIXED_AREA = 0.5  # sd of ln(area) below which an area is determined


Annealed = Callable[[Floats, Floats, Floats, Floats], LogEvidence]


class Overlay(NamedTuple):
    """An affine map from one solution to another, and draws of the other in the same order.

    Attributes
    ----------
    matrix, shift : (D, D), (D,)
        z → M z + c.
    there : (n, D)
        Draws of the other solution, with facets in the order of the first.
    centre : (D,)
        Of these draws.
    """

    matrix: Floats
    shift: Floats
    there: Floats
    centre: Floats


class Form(NamedTuple):
    """Draws of a solution and the part of their coordinates that the data determine.

    Attributes
    ----------
    z : (n, D)
        Facets in the order of the centre.
    centre : (D,)
    determined : (D,) bool
    turn : (3, 3)
        Takes normals to the inertial axes in the middle of a pass. Between passes, rotations that
        differ by a turn have different phases.
    """

    z: Floats
    centre: Floats
    determined: NDArray[np.bool_]
    turn: Floats


def related(
    modes: list[Mode],
    problem: Problem,
    order: FacetOrder,
    data: Epochs,
    share: float,
    annealed: Annealed,
) -> tuple[list[Mode], float]:
    """Rotations with ratios of their evidences, and the error of Gaussian approximations, nats.

    Weak facets make the Gaussian approximation of a rotation's evidence a poor one. ``share`` is
    the part of the posterior that was not sampled, by that approximation; ``annealed`` is as in
    `with_annealed`.
    """
    if len(modes) < 2:
        return modes, APART_SE
    modes = with_ratios(modes, problem, order, data)
    # Weights are of no use where much of the posterior was not sampled.
    if share <= MAX_LEFT_OUT:
        modes = with_annealed(modes, problem, order, data, annealed)
    return modes, gaussian_error(modes)


def with_ratios(
    modes: Sequence[Mode], problem: Problem, order: FacetOrder, data: Epochs
) -> list[Mode]:
    """The solutions with evidences relative to that of the first, whose error is set to zero.

    A solution whose posterior overlaps neither with that of the first nor, by a bridge, with that
    of another that is related to it, gets the ratio of the Gaussian (Laplace) approximations with
    an error of `APART_SE`.
    """
    first, *others = sorted(modes, key=lambda m: -m.solution.log_evidence)
    base = replace(first, log_evidence=LogEvidence(first.log_evidence.value, 0.0))
    found, bridged = [base], [(_form(first, problem, order, data), LogEvidence(0.0, 0.0))]
    for mode in others:
        form = _form(mode, problem, order, data)
        ratio = LogEvidence(_gaussian_ratio(mode, first), APART_SE)
        for other, known in bridged:
            step = _ratio(other, form, problem, order, data)
            se = float(np.hypot(known.se, step.se))
            if se < LARGEST_SE:
                ratio = LogEvidence(known.value + step.value, se)
                bridged.append((form, ratio))
                break
        found.append(_at_ratio(mode, base, ratio))
    return found


def with_annealed(
    modes: Sequence[Mode],
    problem: Problem,
    order: FacetOrder,
    data: Epochs,
    annealed: Annealed,
) -> list[Mode]:
    """The solutions of `with_ratios`; where no bridge holds, with ratios of evidences by annealing.

    ``annealed`` is a function of draws of the first solution and of another, and of the map that
    takes the first to the other. Ratios with larger errors are left as they are.
    """
    base, *others = modes
    if all(mode.log_evidence.se < APART_SE for mode in others):
        return list(modes)
    first = _form(base, problem, order, data)

    def measured(mode: Mode) -> Mode:
        if mode.log_evidence.se < APART_SE:
            return mode
        second = _form(mode, problem, order, data)
        matrix, shift, there, _ = _overlay(first, second, problem, order)
        ratio = annealed(first.z, there, matrix, shift)
        return _at_ratio(mode, base, ratio) if ratio.se < APART_SE else mode

    return [base, *map(measured, others)]


def gaussian_error(modes: Sequence[Mode]) -> float:
    """Largest error (nats) of the Gaussian approximations of ratios of evidences.

    It is `APART_SE` where a ratio is uncertain or there are fewer than `FEWEST`. Solutions of one
    form that were not sampled are approximated about as well as those that were.
    """
    base, *others = modes
    if len(others) < FEWEST or any(m.log_evidence.se >= LARGEST_SE for m in others):
        return APART_SE
    errors = (
        abs(m.log_evidence.value - base.log_evidence.value - _gaussian_ratio(m, base))
        + m.log_evidence.se
        for m in others
    )
    return min(max(errors), APART_SE)


def _gaussian_ratio(mode: Mode, base: Mode) -> float:
    return mode.solution.log_evidence - base.solution.log_evidence


def _at_ratio(mode: Mode, base: Mode, ratio: LogEvidence) -> Mode:
    value = base.log_evidence.value + ratio.value
    return replace(mode, log_evidence=LogEvidence(value, ratio.se))


def _form(mode: Mode, problem: Problem, order: FacetOrder, data: Epochs) -> Form:
    z = evenly(mode.z.reshape(-1, mode.z.shape[-1]), DRAWS)
    centre = z.mean(axis=0)
    z = order.like_all(z, centre)
    normals, areas = problem.rows([NORMALS]).reshape(-1, 3), problem.rows([AREAS])
    units = z[:, normals] / np.linalg.norm(z[:, normals], axis=-1, keepdims=True)
    fixed = np.linalg.norm(units.mean(axis=0), axis=-1) > FIXED
    fixed &= z[:, areas].std(axis=0) < FIXED_AREA
    determined = np.ones(z.shape[1], bool)
    determined[normals[~fixed].ravel()] = False
    determined[areas[~fixed]] = False
    mean = z.mean(axis=0)
    mean[normals[~fixed]] = [0.0, 0.0, 1.0]
    turn = attitudes(problem, data, mean)[_middle_of_a_pass(data)].T
    return Form(z, centre, determined, turn)


def _middle_of_a_pass(data: Epochs) -> int:
    """The epoch in the middle of the pass with the most points."""
    t = np.asarray(data.t)
    rows = max(split(t, np.zeros(t.size, int)), key=len)
    middle = 0.5 * (t[rows[0]] + t[rows[-1]])
    return int(rows[np.argmin(np.abs(t[rows] - middle))])


def _overlay(a: Form, b: Form, problem: Problem, order: FacetOrder) -> Overlay:
    """The map from a to b. Normals turn with the body, and what both determine has the mean and the
    covariance of b."""
    normals = problem.rows([NORMALS]).reshape(-1, 3)
    turn = np.eye(problem.dim)
    for rows in normals:
        turn[np.ix_(rows, rows)] = b.turn.T @ a.turn
    columns = order.carried(b.centre, turn @ a.centre, np.arange(float(problem.dim))).astype(int)
    there, away = b.z[:, columns], a.z @ turn.T
    rows = np.flatnonzero(a.determined & b.determined[columns])

    def moments(z: Floats) -> tuple[Floats, Floats]:
        part = z[:, rows]
        return part.mean(axis=0), np.linalg.cholesky(np.cov(part.T).reshape(len(rows), -1))

    (mean_a, root_a), (mean_b, root_b) = moments(away), moments(there)
    scaled, shift = np.eye(problem.dim), np.zeros(problem.dim)
    scaled[np.ix_(rows, rows)] = root_b @ np.linalg.inv(root_a)
    shift[rows] = mean_b - scaled[np.ix_(rows, rows)] @ mean_a
    return Overlay(scaled @ turn, shift, there, b.centre[columns])


def _ratio(a: Form, b: Form, problem: Problem, order: FacetOrder, data: Epochs) -> LogEvidence:
    """ln Z_b/Z_a, from draws of each and their images on the other."""
    matrix, shift, there, centre = _overlay(a, b, problem, order)
    on_b, on_a = a.z @ matrix.T + shift, np.linalg.solve(matrix, (there - shift).T).T
    stretch = np.linalg.slogdet(matrix)[1]

    def log_density(z: Floats, centre: Floats) -> Floats:
        inside = np.all(order.like_all(z, centre) == z, axis=1)
        return np.where(inside, -potentials(problem, z, data), -np.inf)

    at_a = log_density(on_b, centre) + stretch - log_density(a.z, a.centre)
    at_b = log_density(there, centre) + stretch - log_density(on_a, a.centre)
    return log_ratio(at_b, at_a, EFFECTIVE, EFFECTIVE)
