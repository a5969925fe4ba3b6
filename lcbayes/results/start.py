"""The spins found by `lcbayes scan` or `lcbayes spin`, as the start of a fit."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from lcbayes.core.constants import HOUR_S
from lcbayes.core.errors import InputError
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.spin.pole import MULTIPLES
from lcbayes.modelling.variables import SPIN
from lcbayes.results.load import read_json
from lcbayes.results.record import read_record
from lcbayes.results.store import task_of

SPREAD = 0.01  # relative: half-length of the range about a candidate period
UNCERTAIN = ("period-not-unique", "curve-contradicts")  # codes of reasons against a period
REACH = 5.0  # sd of a sidereal period, if that is more


@dataclass(frozen=True)
class Start:
    """What a fit starts from.

    Attributes
    ----------
    spins : list of dict
        Solutions with pole and period, from which the search starts.
    periods : str
        Candidate periods, as `modelling.known_spin.KnownSpin` reads them; empty for a scan.
    doubt : str
        Why the period of a scan of sparse points is uncertain. A fit keeps near that period, so
        that its own draws cannot show this. Empty if it is certain.
    """

    spins: list[dict[str, Any]]
    periods: str = ""
    doubt: str = ""

    @property
    def ranges(self) -> str:
        """``periods``, or ranges about the periods of a scan."""
        periods = [float(s["period_h"]) * HOUR_S for s in self.spins]
        ends = [(p * math.exp(-SPREAD), p * math.exp(SPREAD)) for p in periods]
        return self.periods or _listed(_joined(ends))


def read_start(folder: str | Path, curve: LightCurve) -> Start:
    """What a fit of this light curve starts from, in the folder of a scan or of `lcbayes spin`.

    Raises
    ------
    InputError
        The folder holds neither, or is of another light curve, or no spin was found.
    """
    folder = Path(folder)
    task = task_of(folder)
    if task not in ("scan", "spin"):
        raise InputError(
            f"{folder} holds no scan and no spin; give the folder that lcbayes scan -o or "
            "lcbayes spin -o wrote"
        )
    summary = read_json(folder / "summary.json", {"solutions": list})
    _, known = read_record(folder / "run.toml").inputs.get("curve", ("", None))
    if known != curve.source.get("sha256"):
        raise InputError(
            f"the {task} in {folder} is of another light curve; give the same command for this "
            "one, then start from that"
        )
    solutions: list[Any] = summary.get("solutions") or []
    if task == "spin":
        spins = [s for s in solutions if _numbers(s, ("pole_lon_deg", "pole_lat_deg", "period_h"))]
        periods = ",".join(candidate_periods(summary))
        if not periods:
            raise InputError(f"the spin in {folder} found no period to start from")
        return Start(spins, periods)
    spins = [s for s in solutions if _numbers(s, SPIN) and s.get("near_equal")]
    if not spins:
        raise InputError(f"the scan in {folder} found no constant spin to start from")
    return Start(spins, doubt=_doubt(summary))


def _doubt(summary: dict[str, Any]) -> str:
    """The reasons against the period of a scan whose solutions have probabilities."""
    if summary.get("period_probability") is None:
        return ""  # spins that fit as well are all followed by the fit
    reasons: list[Any] = summary.get("reasons") or []
    return "; ".join(str(r["text"]) for r in reasons if r["code"] in UNCERTAIN)


def candidate_periods(summary: dict[str, Any]) -> list[str]:
    """Ranges of sidereal periods, such as ``23.5-23.9s``, from the summary of `lcbayes spin`.

    They are those of its solutions, or `MULTIPLES` of the period of the brightness if it has none.
    The ranges are wide and the prior within them is nearly flat, because the same data follow.

    Examples
    --------
    >>> candidate_periods({"solutions": [], "photometric_period_s": 10.0})
    ['9.9-10.1s', '19.8-20.2s', '39.6-40.4s']
    """
    wanted = ("period_s", "period_sd_s")
    solutions: list[Any] = summary.get("solutions") or []
    ends: list[tuple[float, float]] = []
    for solution in solutions:
        if _numbers(solution, wanted):
            period, sd = float(solution["period_s"]), float(solution["period_sd_s"])
            spread = math.exp(max(SPREAD, REACH * sd / period))
            ends.append((period / spread, period * spread))
    if ends:
        return _listed(_joined(ends)).split(",")
    base = summary.get("photometric_period_s")
    if not isinstance(base, int | float) or not 0 < base < math.inf:
        return []
    low, high = (1 - SPREAD) * base, (1 + SPREAD) * base
    return [f"{m * low:.8g}-{m * high:.8g}s" for m in MULTIPLES]


def _joined(ranges: Iterable[tuple[float, float]]) -> list[tuple[float, float]]:
    """Disjoint ranges that cover the same values, ascending."""
    joined: list[tuple[float, float]] = []
    for low, high in sorted(ranges):
        if joined and low <= joined[-1][1]:
            joined[-1] = joined[-1][0], max(high, joined[-1][1])
        else:
            joined.append((low, high))
    return joined


def _listed(ranges: Iterable[tuple[float, float]]) -> str:
    """Ranges in seconds as `modelling.known_spin.KnownSpin` reads them."""
    return ",".join(f"{low:.8g}-{high:.8g}s" for low, high in ranges)


def _numbers(solution: Any, names: Iterable[str]) -> bool:
    """Whether a solution is a mapping with finite numbers of these names."""
    if not isinstance(solution, dict):
        return False
    entries = cast("dict[str, Any]", solution)
    return all(isinstance(entries.get(k), int | float) and math.isfinite(entries[k]) for k in names)
