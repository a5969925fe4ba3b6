"""Functions of many rows, evaluated in blocks of one size: small on a CPU and large on a GPU."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.jax_setup import jax
from lcbayes.core.threads import threads

ROWS = 256


def together(on_cpu: int, on_accelerator: int) -> int:
    """Rows in a block: few on a CPU, so that they stay in its caches, many on an accelerator."""
    return on_cpu if jax.default_backend() == "cpu" else on_accelerator


def each(f: Callable[..., Any], rows: Any) -> Any:
    """f of every row of a pytree: one after the other on a CPU, in parallel on an accelerator."""
    return jax.lax.map(f, rows) if jax.default_backend() == "cpu" else jax.vmap(f)(rows)


def on_all_cores(f: Callable[..., Any], *rows: Any, size: int = ROWS) -> Any:
    """`in_blocks` of some rows, with a thread on each core."""

    def over(one: Callable[..., Any], index: NDArray[np.int64]) -> Iterator[Any]:
        yield one(index[0])  # alone, so that the program is compiled once
        with threads(os.cpu_count() or 1) as pool:
            yield from pool.map(one, index[1:])

    return in_blocks(f, size, *rows, over=over)


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
