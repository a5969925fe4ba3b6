"""Tangents of functions whose derivative is written out."""

from __future__ import annotations

from typing import Any

from jax.custom_derivatives import SymbolicZero

from lcbayes.core.jax_setup import jax


def present(tangents: Any) -> Any:
    """The tangents of a custom derivative, with None for each that is known to be zero.

    None is no argument of a compiled function, so that it can depend on what is there.
    """

    def known_zero(x: Any) -> bool:
        return isinstance(x, SymbolicZero)

    return jax.tree.map(lambda x: None if known_zero(x) else x, tangents, is_leaf=known_zero)
