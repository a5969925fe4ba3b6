"""Rows in blocks of one program."""

from __future__ import annotations

import numpy as np
import pytest

from lcbayes.core.blocks import in_turn
from lcbayes.core.jax_setup import jax, jnp


@pytest.mark.parametrize("size", [1, 3, 4, 7, 8, 100])
def test_blocks_change_neither_value_nor_slope(size):
    """Seven rows: whole blocks, a remainder, one block, and fewer rows than a block has."""
    first = jnp.linspace(0.0, 1.0, 7)
    second = jnp.asarray(np.random.default_rng(1).normal(size=(7, 3)))

    def whole(x, y):
        return jnp.sin(x) * jnp.sum(y**3, axis=1)

    def total(f):
        return lambda x, y: jnp.sum(f(x, y) * jnp.arange(1.0, 8.0))

    def blocks(x, y):
        return in_turn(whole, size, x, y)

    np.testing.assert_allclose(blocks(first, second), whole(first, second), rtol=1e-15)
    for k in (0, 1):
        got, expected = (jax.grad(total(f), argnums=k)(first, second) for f in (blocks, whole))
        np.testing.assert_allclose(got, expected, rtol=1e-14, atol=1e-15)
