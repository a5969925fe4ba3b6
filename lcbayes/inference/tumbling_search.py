"""The search for the torque-free motion of a body of facets: independent searches that must agree.

Bodies with motions from the prior are optimised with errors that shrink (`annealed_search`), and
facets of the best are then put elsewhere. One such search may end at a wrong motion. Searches of
two kinds are therefore repeated in turn, from other and more starts, until two have ended at the
same best motion and this explains the data, or three have ended at different motions that explain
them nearly equally well. In that case the data do not determine the motion, and further searches
find further ones.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from lcbayes.core.checkpoint import Checkpoint
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.progress import Silent
from lcbayes.inference import search
from lcbayes.inference.annealed_search import GROWING, WHOLE, annealed
from lcbayes.inference.facet_climb import climbed
from lcbayes.inference.goodness_of_fit import measure
from lcbayes.inference.motions import Floats, motion, same_motion
from lcbayes.inference.search import SearchState
from lcbayes.inference.solutions import completed, optimum
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.physics.brightness import DIFFUSE_LAWS
from lcbayes.samplers.facet_moves import AREAS, NORMALS

INERTIA = "inertia_base"
STARTS = 16_000  # of one search
MOST = 6  # searches
AGREE = 2  # searches that must end at the best motion
DIFFERENT = 3  # motions that explain the data, one of each search, from which no search is repeated
NEARLY = 1.0  # nats above the best optimum that count as the best
COMPARABLE = 5.0  # nats above the best optimum of motions that the data do not tell from the best


@dataclass(frozen=True)
class Repeats:
    """Independent searches.

    Attributes
    ----------
    searches : int
    agree : int
        The number that found the best motion.
    different : int
        Number of different motions at which searches ended and which explain the data nearly as
        well as the best; 0 if the best does not.
    starts : int
        Of all searches.
    """

    searches: int
    agree: int
    different: int
    starts: int

    @property
    def undetermined(self) -> bool:
        """Whether the data do not determine the motion."""
        return self.agree < AGREE and self.different >= DIFFERENT


def applies(problem: Problem, options: Mapping[str, Any]) -> bool:
    """Whether a fit is of a body of diffuse facets in torque-free motion."""
    return {NORMALS, AREAS, INERTIA} <= set(problem.names) and (
        options.get("reflectance") in DIFFUSE_LAWS
    )


def repeated(
    problems: tuple[Problem, Problem],
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
    problems : pair of Problem
        That of the search, without clock offsets and a slow change of the rate, and that of the
        model itself, by which the data are explained or not.
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
    problem, plain = problems
    found: list[SearchState] = []
    # the shape that `annealed` gives it, so that programs are compiled once
    pointwise = replace(data, information=data.information * jnp.ones(data.t.size))
    number = [(num_starts or STARTS) * 2 ** (i // AGREE) for i in range(MOST)]

    def one(i: int) -> SearchState:
        own, law = jax.random.fold_in(key, i), options["reflectance"]
        stages = (WHOLE, GROWING)[i % 2]
        ends = annealed(problem, pointwise, law, stages, number[i], own, workers, progress)
        return climbed(problem, pointwise, law, ends, workers, progress)

    for i in range(MOST):
        found.append(checkpoint.once(f"tumbling-{i}", SearchState, partial(one, i)))
        repeats = _compared(problem, plain, data, found, sum(number[: i + 1]))
        if repeats.different and (repeats.agree >= AGREE or repeats.undetermined):
            break
    return search.joined(*found), repeats


def _compared(
    problem: Problem, plain: Problem, data: Epochs, found: list[SearchState], starts: int
) -> Repeats:
    """How far the searches agree."""
    best = min(found, key=lambda ends: float(ends.potential[0]))
    lowest = float(best.potential[0])

    def near(ends: SearchState, nats: float) -> Floats:
        return np.asarray(ends.z)[np.asarray(ends.potential) < lowest + nats]

    def moving(z: Floats) -> Floats:
        return motion(problem, data, z)

    first = moving(best.z[0])
    agree = sum(any(same_motion(first, moving(z)) for z in near(ends, NEARLY)) for ends in found)
    different: list[Floats] = []
    (begin,) = completed(problem, plain, data, best.z[:1])
    z, _ = optimum(plain, data, begin, np.arange(plain.dim))
    if measure(plain, data, z[None]).explained:
        for ends in found:
            own = [moving(z) for z in near(ends, COMPARABLE)[:1]]  # none if its best is too high
            different += [m for m in own if not any(same_motion(m, d) for d in different)]
    return Repeats(len(found), agree, len(different), starts)
