"""A limit of time holds within its block, in its thread."""

from __future__ import annotations

import threading
import time

import pytest

from lcbayes.core.time_limit import OutOfTime, check_time, time_limit


def test_a_limit_ends_with_its_block():
    check_time()
    with time_limit(60.0):
        check_time()
        with time_limit(0.01):
            time.sleep(0.02)
            with pytest.raises(OutOfTime, match=r"longer than the limit of 0\.01 s"):
                check_time()
        check_time()
        with time_limit(None):
            check_time()


def test_other_threads_are_not_limited():
    faults = []

    def other():
        try:
            check_time()
        except OutOfTime as fault:
            faults.append(fault)

    with time_limit(0.0):
        thread = threading.Thread(target=other)
        thread.start()
        thread.join()
        with pytest.raises(OutOfTime):
            check_time()
    assert faults == []
