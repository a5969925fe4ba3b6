"""A limit on the time of one computation, checked between its steps."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_end: ContextVar[tuple[float, float] | None] = ContextVar("end", default=None)


class OutOfTime(Exception):
    """A computation took longer than its limit."""


@contextmanager
def time_limit(seconds: float | None) -> Iterator[None]:
    """Limit the time between here and the end of the block; None for no limit.

    Nothing is interrupted from outside: `check_time` raises in the steps of a computation. Threads
    that the block starts are not limited.

    Examples
    --------
    >>> with time_limit(0.0):
    ...     check_time()
    Traceback (most recent call last):
    lcbayes.core.time_limit.OutOfTime: took longer than the limit of 0 s
    """
    token = _end.set(None if seconds is None else (time.monotonic() + seconds, seconds))
    try:
        yield
    finally:
        _end.reset(token)


def check_time() -> None:
    """Raise `OutOfTime` if the limit of the surrounding block has passed."""
    limit = _end.get()
    if limit is not None and time.monotonic() >= limit[0]:
        raise OutOfTime(f"took longer than the limit of {limit[1]:g} s")
