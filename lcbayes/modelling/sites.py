"""The sites of a model and what depends on them, found by tracing it instead of running it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from jax.core import Tracer
from jax.interpreters.partial_eval import dce_jaxpr

from lcbayes.core.jax_setup import jax
from lcbayes.modelling.epochs import Epochs

Trace = dict[str, Any]


def sites_and_supports(trace: Callable[[Epochs], Trace], data: Epochs) -> tuple[Trace, Trace]:
    """The sites of a model, and the supports of the latent ones.

    If a model runs, each of its operations is compiled by itself, which takes seconds. It is traced
    here, so that the values of its sites have shapes only; what its supports are computed from is
    the one program that runs.
    """
    sites: Trace = {}
    supports: dict[str, tuple[list[Any], Any]] = {}

    def computed(data: Epochs) -> dict[str, dict[int, jax.Array]]:
        sites.update(trace(data))
        for name, site in sites.items():
            if site["type"] == "sample" and not site["is_observed"]:
                supports[name] = jax.tree.flatten(site["fn"].support)
        return {
            name: {i: x for i, x in enumerate(leaves) if isinstance(x, Tracer)}
            for name, (leaves, _) in supports.items()
        }

    values = jax.jit(computed)(data)
    return sites, {
        name: jax.tree.unflatten(structure, [values[name].get(i, x) for i, x in enumerate(leaves)])
        for name, (leaves, structure) in supports.items()
    }


def reaching(f: Callable[[Trace], Any], sites: Trace) -> tuple[str, ...]:
    """The sites that f depends on."""
    leaves = jax.make_jaxpr(f)(sites)
    _, used = dce_jaxpr(leaves.jaxpr, [True] * len(leaves.jaxpr.outvars))
    return tuple(k for k, u in zip(sorted(sites), used, strict=True) if u)


def zeros(values: Any) -> Any:
    """Zeros of the shapes and types of values that may be traced."""
    return jax.tree.map(lambda x: np.zeros(x.shape, x.dtype), values)
