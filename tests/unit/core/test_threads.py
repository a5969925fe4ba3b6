"""BLAS has no threads of its own while ours work, and has them back afterwards."""

from __future__ import annotations

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from lcbayes.core.threads import threads


def blas_threads() -> set[int]:
    return {one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"}


@pytest.fixture(autouse=True)
def _three():
    with threadpool_limits(3, user_api="blas"):
        yield


def test_blas_is_held_to_one_thread_and_let_go():
    with threads(2) as pool:
        assert blas_threads() == {1}
        assert list(pool.map(np.square, range(4))) == [0, 1, 4, 9]
    assert blas_threads() == {3}


def test_pools_that_overlap_let_go_when_the_last_is_closed():
    """A first that ends before the second must neither free BLAS too early nor hold it for ever."""
    first, second = threads(1), threads(1)
    first.__enter__()
    second.__enter__()
    first.__exit__(None, None, None)
    assert blas_threads() == {1}
    second.__exit__(None, None, None)
    assert blas_threads() == {3}


def test_blas_is_let_go_after_a_failure():
    with pytest.raises(ZeroDivisionError), threads(1) as pool:
        pool.submit(lambda: 1 / 0).result()
    assert blas_threads() == {3}
