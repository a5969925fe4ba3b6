"""One problem for all light curves of a structure, so that one compilation serves them.

JAX keeps a compiled program for each problem. Two light curves of one model, with the same options,
numbers of points and groups, pose problems that differ in their numbers alone, and those are
arguments of the programs.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from typing import Any

from lcbayes._jax import jax
from lcbayes.epochs import Epochs
from lcbayes.gallery import Entry
from lcbayes.inference import sample
from lcbayes.inference.problem import Problem

_kept: dict[Hashable, tuple[Problem, Problem]] = {}


def posed(entry: Entry, options: Mapping[str, Any], data: Epochs) -> tuple[Problem, Problem]:
    """The posterior of a model given a light curve: as the model has it, and in the coordinates in
    which it is sampled, which are the same where the model has none of its own. A model's own
    coordinates may hold numbers of its light curve, so such problems are not shared."""
    leaves, structure = jax.tree.flatten(data)
    shapes = tuple((x.shape, str(x.dtype)) for x in leaves)
    key: Hashable = (entry.module, tuple(sorted(options.items())), structure, shapes)
    hook = entry.hook("coordinates")
    if hook is not None:
        key = (key, len(_kept))
    if key not in _kept:
        plain = Problem(entry.bind(options), data)
        own = Problem(entry.bind(options), data, hook(data, **options)) if hook else plain
        _kept[key] = plain, own
    return _kept[key]


def structures() -> int:
    """How many are kept, with the programs of each."""
    return len(_kept)


def forget() -> None:
    """Let go of all problems and programs: a process that meets many structures must do so now and
    then, since each of them keeps a thousand maps of memory and a process is allowed 65 530."""
    _kept.clear()
    sample.programs.cache_clear()
    jax.clear_caches()
