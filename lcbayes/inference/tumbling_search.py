"""The search for the torque-free motion of a body of facets: independent searches that must agree.

Motions from the prior follow the data as these grow in time (`growing_search`), and facets of the
best bodies are then put elsewhere. One such search may end at a wrong motion. Searches are
therefore repeated, from other and more starts, until two have ended at the same best motion and
this explains the data.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from lcbayes.core.checkpoint import Checkpoint
from lcbayes.core.jax_setup import jax
from lcbayes.core.progress import Silent
from lcbayes.inference import search
from lcbayes.inference.facet_climb import climbed
from lcbayes.inference.goodness_of_fit import measure
from lcbayes.inference.growing_search import grown
from lcbayes.inference.motions import motion, same_motion
from lcbayes.inference.search import SearchState
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.physics.brightness import DIFFUSE_LAWS
from lcbayes.samplers.facet_moves import AREAS, NORMALS

INERTIA = "inertia_base"
STARTS = 2000  # of one search
MOST = 6  # searches
AGREE = 2  # searches that must end at the best motion
NEARLY = 1.0  # nats above the best optimum that count as the best


@dataclass(frozen=True)
class Repeats:
    """Independent searches.

    Attributes
    ----------
    searches : int
    agree : int
        The number that found the best motion.
    starts : int
        Of all searches.
    """

    searches: int
    agree: int
    starts: int


def applies(problem: Problem, options: Mapping[str, Any]) -> bool:
    """Whether a fit is of a body of diffuse facets in torque-free motion."""
    return {NORMALS, AREAS, INERTIA} <= set(problem.names) and (
        options.get("reflectance") in DIFFUSE_LAWS
    )


def repeated(
    problem: Problem,
    data: Epochs,
    options: Mapping[str, Any],
    num_starts: int,
    key: jax.Array,
    workers: int,
    progress: Silent,
    checkpoint: Checkpoint,
) -> tuple[SearchState, Repeats]:
    """Optima of the posterior, best first, and how many independent searches found the best.

    Parameters
    ----------
    problem : Problem
    data : Epochs
    options : mapping
        Of the model, with defaults: ``reflectance``.
    num_starts : int
        Of each of the first two searches, and twice as many of each further pair; 0 for `STARTS`.
    key : random key
    workers : int
    progress : Silent
    checkpoint : Checkpoint
        Keeps the end points of each search, from which an interrupted run goes on.
    """
    found: list[SearchState] = []
    number = [(num_starts or STARTS) * 2 ** (i // AGREE) for i in range(MOST)]

    def one(i: int) -> SearchState:
        own, law = jax.random.fold_in(key, i), options["reflectance"]
        ends = grown(problem, data, law, number[i], own, workers, progress)
        return climbed(problem, data, law, ends, workers, progress)

    for i in range(MOST):
        found.append(checkpoint.once(f"tumbling-{i}", SearchState, partial(one, i)))
        agree = _agreeing(problem, data, found)
        if agree >= AGREE and measure(problem, data, _best(found).z[:1]).explained:
            break
    repeats = Repeats(len(found), agree, sum(number[: len(found)]))
    return search.joined(*found), repeats


def _agreeing(problem: Problem, data: Epochs, found: list[SearchState]) -> int:
    """Number of searches that found the best motion."""
    best = _best(found)
    moving = motion(problem, data, best.z[0])
    limit = float(best.potential[0]) + NEARLY
    return sum(
        any(
            same_motion(moving, motion(problem, data, z))
            for z in ends.z[np.asarray(ends.potential) < limit]
        )
        for ends in found
    )


def _best(found: list[SearchState]) -> SearchState:
    return min(found, key=lambda ends: float(ends.potential[0]))
