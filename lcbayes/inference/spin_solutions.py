"""The spins of all plausible solutions of a search, sampled or not."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.jax_setup import jnp
from lcbayes.core.reasons import Finding
from lcbayes.inference.modes import MAX_LEFT_OUT, shares
from lcbayes.inference.solutions import Solution
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem, compiled

Floats = NDArray[np.float64]
ONE_PERIOD = 1e-3  # relative range of periods that are reported as one
ONE_AXIS_DEG = 10.0  # greatest angle between axes that are reported as one


class SpinSolution(NamedTuple):
    """A constant rotation that explains the data.

    Attributes
    ----------
    period_s : float
    omega_rad_s : list of float
        Angular velocity, in the axes of the light curve.
    share : float
        Share of the posterior by the Gaussian (Laplace) approximation of each solution.
    sampled : bool
        Whether chains describe it.
    """

    period_s: float
    omega_rad_s: list[float]
    share: float
    sampled: bool


def spin_solutions(
    problem: Problem,
    data: Epochs,
    sampled: Sequence[Solution],
    rest: Sequence[Solution],
    error: float = 0.0,
) -> list[SpinSolution]:
    """The spins of solutions in the coordinates of ``problem``, the most probable first.

    Solutions whose share is below `MAX_LEFT_OUT`, even by twice the standard ``error`` (nats) of
    the evidences, are left out, as are those of models without a constant rotation.
    """
    every = [*sampled, *rest]
    if "omega_unit" not in problem.names or "inertia_base" in problem.names:
        return []
    spins = []
    for i, (solution, part) in enumerate(zip(every, shares(every), strict=True)):
        omega = np.asarray(compiled(problem.constrain)(jnp.asarray(solution.z), data)["omega"])
        rate = float(np.linalg.norm(omega))
        if largest_share(part, error) > MAX_LEFT_OUT and rate > 0.0:
            spin = SpinSolution(2 * np.pi / rate, omega.tolist(), float(part), i < len(sampled))
            spins.append(spin)
    return sorted(spins, key=lambda s: -s.share)


def largest_share(share: float, error: float) -> float:
    """The share of the posterior if the evidence is too low by twice its ``error`` (nats)."""
    if share <= 0.0:
        return 0.0
    # as a logarithm, since the error of a bridge that fails may be of any size
    return float(np.exp(min(0.0, np.log(share) + 2.0 * error)))


def undetermined(spins: Sequence[SpinSolution], share_left: float) -> list[Finding]:
    """The finding that several spins explain the data and some of them were not sampled.

    ``share_left`` is the largest share of the posterior that those may hold. Two
    opposite axes count as one, because many light curves cannot tell them apart.
    """
    if share_left <= MAX_LEFT_OUT or len(spins) < 2:
        return []
    periods = np.array([s.period_s for s in spins])
    axes = np.array([s.omega_rad_s for s in spins])
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    apart = float(np.degrees(np.arccos(np.clip(np.abs(axes @ axes.T), 0.0, 1.0)).max()))
    if np.ptp(periods) < ONE_PERIOD * periods.min() and apart < ONE_AXIS_DEG:
        return []
    values = {
        "number": len(spins),
        "shortest_s": float(periods.min()),
        "longest_s": float(periods.max()),
        "axes": "one axis" if apart < 1.0 else f"axes up to {apart:.0f} deg apart",
        "percent": 100 * share_left,
    }
    return [Finding("spin-undetermined", values)]
