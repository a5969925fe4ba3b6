"""Threads that each do small linear algebra, on libraries that would take all cores for each."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager
from threading import Lock

import scipy.linalg  # noqa: F401  loads the BLAS that JAX calls, which is not NumPy's
from threadpoolctl import threadpool_limits


@contextmanager
def threads(n: int) -> Iterator[Executor]:
    """n threads; until the last of all such pools is closed BLAS has one thread to a call.

    Of the matrices of a posterior with a few dozen parameters BLAS would make so little work for
    each core that waking the threads takes longer, and they would take the cores from ours: with
    35 parameters a move of the Fisher-adaptive kernel took 2.8 times as long
    (benchmarks/blas_threads.py), and more where other work had the cores.
    """
    with _alone, ThreadPoolExecutor(n) as pool:
        yield pool


class _Alone:
    """BLAS without threads of its own while anyone is inside. Fits can run beside each other in one
    process; the first limits it, the last lets go."""

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


_alone = _Alone()
