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


def in_turn(f: Callable[..., jax.Array], size: int, *rows: jax.Array) -> jax.Array:
    """f (B,) of blocks of B rows of arrays (T, ...), one after the other in one program, as (T,).

    The blocks are computed again in the backward pass, which is faster than to read them from
    memory if they fit in the cache of a core, and limits the memory use.
    """
    n_blocks, rest = divmod(len(rows[0]), size)
    part = jax.checkpoint(f)
    if n_blocks == 0:
        return part(*rows)
    head = tuple(x[: n_blocks * size].reshape(n_blocks, size, *x.shape[1:]) for x in rows)
    done = jax.lax.map(lambda block: part(*block), head).reshape(-1)
    last = part(*(x[-rest:] for x in rows)) if rest else done[:0]
    return jax.numpy.concatenate([done, last])


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
