"""Threads for small linear algebra, with BLAS limited to one thread per call."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager
from threading import Lock

import scipy.linalg  # noqa: F401  loads the BLAS that JAX calls, which is not NumPy's
from threadpoolctl import threadpool_limits


@contextmanager
def threads(n: int) -> Iterator[Executor]:
    """A pool of n threads; BLAS uses one thread per call until the last such pool is closed.

    For the matrices of a posterior with a few dozen parameters, multithreaded BLAS spends more time
    on waking its threads than on the computation, and its threads compete with those of this pool.
    With 35 parameters a move of the Fisher-adaptive kernel took 2.8 times as long
    (benchmarks/blas_threads.py), and longer still when other processes used the cores.
    """
    with single_threaded_blas, ThreadPoolExecutor(n) as pool:
        yield pool


class _SingleThreadedBlas:
    """Context in which BLAS is single-threaded.

    Fits can run concurrently in one process: the first sets the limit, the last removes it.
    """

    def __init__(self) -> None:
        self._lock, self._inside = Lock(), 0

    def __enter__(self) -> None:
        with self._lock:
            self._inside += 1
            if self._inside == 1:
                self._limits = threadpool_limits(1, user_api="blas")

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._inside -= 1
            if self._inside == 0:
                self._limits.restore_original_limits()


single_threaded_blas = _SingleThreadedBlas()
