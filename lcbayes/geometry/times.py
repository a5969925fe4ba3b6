"""Times as two-part Julian dates, with leap seconds."""

from __future__ import annotations

import datetime
import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


def date(julian: float, clock: bool = False) -> str:
    """Calendar date of a Julian date, with hours and minutes if ``clock`` is true."""
    moment = datetime.datetime(2000, 1, 1, 12) + datetime.timedelta(days=julian - 2451545.0)
    return moment.strftime("%Y-%m-%d %H:%M" if clock else "%Y-%m-%d")


@dataclass(frozen=True)
class Times:
    """Times as two-part Julian dates (T,), whose sum is the date, in the scales used here."""

    utc: tuple[Floats, Floats]
    tt: tuple[Floats, Floats]

    @classmethod
    def of(cls, epoch_jd: float, t: ArrayLike) -> Times:
        """Times from seconds elapsed since a UTC Julian date, including leap seconds."""
        import erfa

        with warnings.catch_warnings():
            warnings.simplefilter("ignore", erfa.ErfaWarning)  # years with unknown leap seconds
            whole = np.floor(epoch_jd)
            tai1, tai2 = erfa.utctai(whole, epoch_jd - whole)
            days, rest = np.divmod(np.atleast_1d(np.asarray(t, dtype=float)), 86400.0)
            tai = tai1 + days, tai2 + rest / 86400.0
            return cls(erfa.taiutc(*tai), erfa.taitt(*tai))

    def text(self, row: int, decimals: int = 0) -> str:
        """One time in ISO 8601, UTC, with a number of decimals of a second."""
        import erfa

        with warnings.catch_warnings():
            warnings.simplefilter("ignore", erfa.ErfaWarning)
            year, month, day, clock = erfa.d2dtf("UTC", decimals, *(x[row] for x in self.utc))
        h, m, s, rest = clock.tolist()
        part = f".{rest:0{decimals}d}" if decimals else ""
        return f"{year:04d}-{month:02d}-{day:02d}T{h:02d}:{m:02d}:{s:02d}{part}Z"


def seconds_between(first_jd: float, second_jd: float) -> float:
    """Seconds from one UTC Julian date to another, with leap seconds as in the file readers."""
    (a1, a2), (b1, b2) = (Times.of(jd, 0.0).tt for jd in (first_jd, second_jd))
    return float(((b1 - a1) + (b2 - a2))[0] * 86400.0)
