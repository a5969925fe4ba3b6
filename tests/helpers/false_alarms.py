"""How seldom the tests fail by chance: limits that keep a rate, and the sum of the rates declared.

A test whose verdict rests on random draws and a threshold says with
``@pytest.mark.statistical(false_alarm=EACH)`` how likely it is to fail with all code right and a
seed drawn anew. Its thresholds follow from that rate by the functions here, divided over all that
the test compares (Bonferroni). The rates of all tests, each case of a parametrised test counted,
may sum to 1 in 1,000 at most: pytest collects no more than that.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pytest
from scipy import stats

EACH = 3e-6  # of one test
MOST = 1e-3  # of all tests together
COLLECTED = pytest.StashKey[float]()  # the sum over what was collected


def limit(comparisons: int = 1, dof: float = np.inf, false_alarm: float = EACH) -> float:
    """Standard errors that none of so many comparisons passes, but for the rate given.

    Two-sided; Student's t where the standard error is an estimate with ``dof`` degrees of freedom.
    """
    return float(stats.t.isf(0.5 * false_alarm / comparisons, dof))


def counts(n: int, p: float, comparisons: int = 1) -> tuple[int, int]:
    """Smallest and largest number of n that happen, each with probability p."""
    tail = 0.5 * EACH / comparisons
    return int(stats.binom.ppf(tail, n, p)), int(stats.binom.isf(tail, n, p))


def squares(dof: float, comparisons: int = 1) -> tuple[float, float]:
    """Least and most of a sum of squares of so many standard normals."""
    tail = 0.5 * EACH / comparisons
    return float(stats.chi2.ppf(tail, dof)), float(stats.chi2.isf(tail, dof))


def total(items: Iterable[pytest.Item]) -> float:
    """Sum of the rates that tests declare.

    Raises
    ------
    pytest.UsageError
        Where a test declares none, or one that is not between 0 and 1 in 10,000.
    """
    result = 0.0
    for item in items:
        mark = item.get_closest_marker("statistical")
        if mark is None:
            continue
        rate = mark.kwargs.get("false_alarm")
        if mark.args or not isinstance(rate, float) or not 0.0 < rate <= 1e-4:
            raise pytest.UsageError(
                f"{item.nodeid}: statistical(false_alarm={rate!r}); give a probability up to 1e-4"
            )
        result += rate
    return result


def check(items: Iterable[pytest.Item]) -> float:
    """`total`; a UsageError where it is more than `MOST`."""
    result = total(items)
    if result > MOST:
        raise pytest.UsageError(
            f"one of the tests would fail by chance in {result:.1e} of all runs, more than "
            f"{MOST:g}; see tests/helpers/false_alarms.py"
        )
    return result
