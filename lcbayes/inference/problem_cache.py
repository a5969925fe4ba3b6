"""A cache of problems, so that light curves of the same structure share compiled programs.

JAX compiles each problem once. Two light curves with the same model, options, number of points and
number of groups give problems that differ only in the arguments of the compiled programs.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from lcbayes.core.jax_setup import jax
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import TRACING, Problem
from lcbayes.modelling.registry import Entry
from lcbayes.samplers import sampling

MAX_STRUCTURES = 12  # in the cache

_kept: list[tuple[tuple, tuple[Problem, Problem]]] = []  # a list, since keys are not hashable


def build_problem(
    entry: Entry, options: Mapping[str, Any], data: Epochs
) -> tuple[Problem, Problem]:
    """The posterior of a model given a light curve, in plain and in sampling coordinates.

    The two are the same object if the model does not define sampling coordinates. Sampling
    coordinates may depend on the light curve; problems are shared only if their coordinates are
    equal.

    At most `MAX_STRUCTURES` structures are cached; the next one empties the cache. Fits that still
    use an earlier problem keep it and compile again.
    """
    leaves, structure = jax.tree.flatten(data)
    shapes = [(x.shape, str(x.dtype)) for x in leaves]
    hook = entry.hook("coordinates")
    with TRACING:
        own = hook(data, **options) if hook else None
        other = set(entry.replaced)  # priors, which joint coordinates do not know
        own = own and {k: v for k, v in own.items() if isinstance(k, str) or not other & set(k)}
        key = (entry.module, dict(options), structure, shapes, own)
        for known, problems in _kept:
            if known == key:
                return problems
        shading = entry.hook("shading")
        shading = None if shading is None else shading(**options)
        model = entry.bind(options)
        plain = Problem(model, data, None, shading)
        problems = plain, plain if own is None else Problem(model, data, own, shading)
        if len(_kept) >= MAX_STRUCTURES:
            forget()
        _kept.append((key, problems))
        return problems


def structures() -> int:
    """Number of structures in the cache."""
    return len(_kept)


def forget() -> None:
    """Empty the cache.

    Each structure uses about a thousand memory maps; the limit per process is 65 530.
    """
    with TRACING:
        _kept.clear()
        sampling.programs.cache_clear()
        jax.clear_caches()
