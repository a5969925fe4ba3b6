"""Durations with their units, as a user writes them."""

from __future__ import annotations

import re

from lcbayes.core.constants import DAY_S, HOUR_S
from lcbayes.core.errors import InputError

NUMBER = r"(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
UNITS = {"s": 1.0, "min": 60.0, "h": HOUR_S, "d": DAY_S, "day": DAY_S, "days": DAY_S}
LISTED = "s, min, h or days"
_DURATION = re.compile(rf"\s*({NUMBER})\s*([a-z]*)\s*")


def seconds(text: str, default: str | None = None) -> float:
    """A duration in seconds.

    Parameters
    ----------
    text : a number with a unit: s, min, h, d, day or days
    default : unit of a number without one; None if it needs one

    Raises
    ------
    InputError

    Examples
    --------
    >>> seconds("1.5 min")
    90.0
    >>> seconds("2", default="h")
    7200.0
    """
    match = _DURATION.fullmatch(text)
    unit = default if match is None else match[2] or default
    if match is None or unit not in UNITS:
        raise InputError(f"{text.strip()!r} is no duration; give a number with {LISTED}")
    return float(match[1]) * UNITS[unit]
