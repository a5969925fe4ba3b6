"""Solutions with one rotation, which differ in the arrangement of their facets only.

A weak facet may lie wherever it is hardly seen, or share the place of a strong one. Each of these
arrangements is an optimum of its own. `samplers.facet_moves` leads chains from one to another, so
that all of them are one solution.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lcbayes.core.jax_setup import jnp
from lcbayes.inference.solutions import Solution
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem, compiled

SAME_PHASE = 1.0  # rad, by which equal rotations may differ at the ends of the light curve
SAME_AXIS_DEG = 20.0


def by_rotation(
    problem: Problem, data: Epochs, solutions: Sequence[Solution]
) -> list[list[Solution]]:
    """The solutions, grouped by the angular velocity ``omega``, the most probable group first.

    Rotations are equal if their axes are within `SAME_AXIS_DEG` and their phases within
    `SAME_PHASE` at the ends of the light curve when they agree in the middle.

    Parameters
    ----------
    problem : Problem
        Whose coordinates those of the solutions are.
    data : Epochs
    solutions : sequence of Solution
    """
    span = float(np.asarray(data.t_span))
    groups: list[tuple[np.ndarray, list[Solution]]] = []
    for solution in sorted(solutions, key=lambda s: -s.log_evidence):
        omega = np.asarray(compiled(problem.constrain)(jnp.asarray(solution.z), data)["omega"])
        for known, members in groups:
            if same_rotation(omega, known, span):
                members.append(solution)
                break
        else:
            groups.append((omega, [solution]))
    members = [m for _, m in groups]
    return sorted(members, key=lambda g: -joint(g).log_evidence)


def joint(group: Sequence[Solution]) -> Solution:
    """The first of a group of solutions, with the evidence and the hits of all."""
    log_evidence = float(np.logaddexp.reduce([s.log_evidence for s in group]))
    return replace(group[0], log_evidence=log_evidence, hits=sum(s.hits for s in group))


def same_rotation(a: np.ndarray, b: np.ndarray, span: float) -> bool:
    """Whether two angular velocities (3,) rad/s are equal, as in `by_rotation`, over ``span`` s."""
    rates = np.linalg.norm(a), np.linalg.norm(b)
    phase = 0.5 * span * abs(rates[0] - rates[1])
    cosine = a @ b / max(rates[0] * rates[1], 1e-300)
    return bool(phase < SAME_PHASE and cosine > np.cos(np.radians(SAME_AXIS_DEG)))
