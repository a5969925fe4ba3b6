"""Functions of many rows, evaluated in blocks of one size."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.jax_setup import jax


def in_blocks(f: Callable[..., Any], size: int, *rows: Any, over: Callable[..., Any] = map) -> Any:
    """f of rows, pytrees that share the first axis, as NumPy arrays.

    A compiled f is compiled once for any number of rows: the last block is filled with further
    rows, whose results are dropped.

    Parameters
    ----------
    f : callable
        Blocks of the rows → pytree of arrays with the same first axis.
    size : int
        Rows in a block.
    *rows : pytrees of arrays (n, ...)
    over : callable
        In place of ``map``, such as that of a pool of threads.

    Examples
    --------
    >>> import numpy as np
    >>> in_blocks(np.square, 4, np.arange(6))
    array([ 0,  1,  4,  9, 16, 25])
    """
    n = len(jax.tree.leaves(rows)[0])
    index = np.resize(np.arange(n), (-(-n // size), size))

    def one(i: NDArray[np.int64]) -> Any:
        return jax.tree.map(np.asarray, f(*jax.tree.map(lambda x: x[i], rows)))

    return jax.tree.map(lambda *x: np.concatenate(x)[:n], *over(one, index))
