"""Solutions with one motion, which differ in the arrangement of their facets only.

A weak facet may lie wherever it is hardly seen, or share the place of a strong one. Each of these
arrangements is an optimum of its own. `samplers.facet_moves` leads chains from one to another, so
that all of them are one solution.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lcbayes.inference.modes import MAX_LEFT_OUT, shares
from lcbayes.inference.motions import motion, same_motion
from lcbayes.inference.solutions import Solution
from lcbayes.inference.spin_solutions import largest_share
from lcbayes.inference.warped_bridge import APART_SE
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem

LARGEST_FACTOR = 2  # of the usual number of motions, if these are all


def by_motion(
    problem: Problem, data: Epochs, solutions: Sequence[Solution]
) -> list[list[Solution]]:
    """The solutions, grouped by the motion of the body, the most probable group first.

    Parameters
    ----------
    problem : Problem
        Whose coordinates those of the solutions are.
    data : Epochs
    solutions : sequence of Solution
    """
    groups: list[tuple[np.ndarray, list[Solution]]] = []
    for solution in sorted(solutions, key=lambda s: -s.log_evidence):
        moving = motion(problem, data, solution.z)
        for known, members in groups:
            if same_motion(known, moving):
                members.append(solution)
                break
        else:
            groups.append((moving, [solution]))
    members = [m for _, m in groups]
    return sorted(members, key=lambda g: -joint(g).log_evidence)


def plausible(group: Sequence[Solution], error: float) -> list[Solution]:
    """The solutions of a group that may hold a noticeable share of it, the best first.

    Chains that begin elsewhere may have no way to the rest: a tumbler has optima of other inertia
    at nearly the same motion. ``error`` is the standard error of the evidences (nats).
    """
    parts = zip(group, shares(group), strict=True)
    return [s for s, part in parts if largest_share(part, error) > MAX_LEFT_OUT]


def number_to_sample(
    groups: Sequence[Sequence[Solution]], most: int, *, near_gaussian: bool = False
) -> int:
    """How many groups to sample: ``most``, or up to `LARGEST_FACTOR` as many if these are all.

    Weights are of use if every group is sampled that may hold a noticeable share of the posterior.
    Where there are many more of these, a few are as good as some more. The shares are those of
    Laplace's approximation; if the posterior is nearly Gaussian, no group without such a share is
    sampled.
    """
    likely = len(plausible([joint(group) for group in groups], APART_SE))
    if near_gaussian:
        return min(most, likely)
    return likely if most < likely <= LARGEST_FACTOR * most else most


def joint(group: Sequence[Solution]) -> Solution:
    """The first of a group of solutions, with the evidence and the hits of all."""
    log_evidence = float(np.logaddexp.reduce([s.log_evidence for s in group]))
    return replace(group[0], log_evidence=log_evidence, hits=sum(s.hits for s in group))
