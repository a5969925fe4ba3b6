"""One problem for all light curves of a structure, so that one compilation serves them.

JAX keeps a compiled program for each problem. Two light curves of one model, with the same options,
numbers of points and groups, pose problems that differ in their numbers alone, and those are
arguments of the programs.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from lcbayes.core.jax_setup import jax
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import TRACING, Problem
from lcbayes.modelling.registry import Entry
from lcbayes.samplers import sampling

MOST = 12  # structures whose programs are kept

_kept: list[tuple[tuple, tuple[Problem, Problem]]] = []  # what is compared need not have a hash


def posed(entry: Entry, options: Mapping[str, Any], data: Epochs) -> tuple[Problem, Problem]:
    """The posterior of a model given a light curve: as the model has it, and in the coordinates in
    which it is sampled, which are the same where the model has none of its own. A model's own
    coordinates may hold numbers of its light curve; problems are shared where these are equal.

    Of more than `MOST` structures all before are let go of. Fits that go on with them elsewhere
    keep their problems and compile again.
    """
    leaves, structure = jax.tree.flatten(data)
    shapes = [(x.shape, str(x.dtype)) for x in leaves]
    hook = entry.hook("coordinates")
    with TRACING:
        own = hook(data, **options) if hook else None
        key = (entry.module, dict(options), structure, shapes, own)
        for known, problems in _kept:
            if known == key:
                return problems
        plain = Problem(entry.bind(options), data)
        problems = plain, plain if own is None else Problem(entry.bind(options), data, own)
        if len(_kept) >= MOST:
            forget()
        _kept.append((key, problems))
        return problems


def structures() -> int:
    """How many are kept, with the programs of each."""
    return len(_kept)


def forget() -> None:
    """Let go of all problems and programs: each structure keeps a thousand maps of memory and a
    process is allowed 65 530."""
    with TRACING:
        _kept.clear()
        sampling.programs.cache_clear()
        jax.clear_caches()
