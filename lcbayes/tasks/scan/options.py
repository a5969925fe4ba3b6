"""Options of `lcbayes scan`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from lcbayes.core.constants import HOUR_S
from lcbayes.core.durations import LISTED, seconds
from lcbayes.core.errors import InputError
from lcbayes.core.options import Options, option
from lcbayes.tasks.task import Task


def hours(text: str) -> float:
    """A duration in hours, from a number of hours or a number with a unit.

    Raises
    ------
    InputError
    """
    try:
        return seconds(text, default="h") / HOUR_S
    except InputError:
        raise InputError(
            f"{text.strip()!r} is no period; give hours, or a number with {LISTED}, such as 30s"
        ) from None


def between(text: str) -> tuple[float, ...]:
    """Two durations in hours, from "FROM,TO".

    Raises
    ------
    InputError
    """
    ends = text.split(",")
    if len(ends) != 2:
        raise InputError(f"--period-range is {text!r}; give FROM,TO, such as 5.7,5.8")
    return hours(ends[0]), hours(ends[1])


def check_range(ends: tuple[float, ...]) -> None:
    """Raise an InputError unless a range of periods, h, is two positive, increasing numbers."""
    if len(ends) != 2:
        raise InputError("--period-range needs two periods: FROM,TO")
    low, high = ends
    if not 0 < low < high:
        raise InputError(
            f"--period-range is {low:g},{high:g}; give the shortest and the longest period, hours"
        )


AUTO, BODIES, PERIODOGRAM = "auto", "bodies", "periodogram"


@dataclass(frozen=True)
class ScanOptions(Options):
    """Options of `lcbayes.scan`."""

    period: float | None = option(
        None,
        unit="hours",
        parse=hours,
        metavar="P",
        help="sidereal period of a spin, or such as 30s",
    )
    period_range: tuple[float, ...] | None = option(
        None,
        unit="hours",
        parse=between,
        metavar="FROM,TO",
        help="periods to try, or such as 20s,90s",
    )
    law: tuple[str, ...] = option(
        (), metavar="NAME", help="a stabilised attitude, or all; may be given several times"
    )
    reflectance: str | None = option(
        None,
        metavar="NAME",
        help="lambertian, non-lambertian, or lommel-seeliger-lambert, the default for asteroids",
    )
    n_poles: int = option(12, low=1, high=10_000, help="poles to start from")
    period_step: float | None = option(
        None,
        above=0.0,
        help="step between trial periods, in half turns over the data; by default 0.8, or 0.5 for "
        "sparse points",
    )
    n_facets: int = option(500, low=50, high=5000, help="facets of the body of refined solutions")
    degree: int | None = option(
        None,
        low=1,
        high=12,
        help="degree of the harmonics of that body; by default 6, or 3 for sparse points",
    )
    keep: int = option(12, low=1, high=100, help="number of solutions to refine")
    n_sky: int = option(200, low=0, high=100_000, help="poles of the map of the sky; 0: no map")
    first_stage: str = option(
        AUTO,
        choices=(AUTO, BODIES, PERIODOGRAM),
        help="bodies are fitted to every pole and period, or all are ranked by a periodogram; by "
        "default by the number of points a night",
    )
    nights: Path | None = option(
        None,
        metavar="FILE",
        help="epochs and geometry of points that could be observed: how far each night, and "
        "several together, would settle the period of sparse points",
    )
    night_error: float = option(0.02, unit="mag", above=0.0, help="error of one of these points")
    common_noise: bool = option(
        False, help="where errors are unknown: one relative noise level for all curves"
    )
    scheduler: str | None = option(None, metavar="ADDRESS", help="a Dask cluster: tcp://…")
    workers: int | None = option(None, low=1, help="processes of a local Dask cluster")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.period_range is not None:
            check_range(self.period_range)


TASK = Task(
    name="scan",
    details="""\
examples:
  lcbayes scan 43_Ariadne.lcs --period-range 5.75,5.775 -o out
  lcbayes scan 43_Ariadne.lcs --period 5.762 -o out
  lcbayes scan survey.lcs -o out
  lcbayes scan survey.lcs --nights next-month.csv --night-error 0.03 -o out
  lcbayes scan tumbler.csv --tle object.tle --period-range 20s,300s --n-poles 24 -o out
  lcbayes scan passes.csv --tle object.tle --law all -o out
  lcbayes scan 43_Ariadne.lcs --period-range 5,6 --scheduler tcp://10.0.0.1:8786 -o out

Periods are sidereal, in hours, or with a unit: 30s, 12min, 5.76h, 2d. A scan ranks;
how well a spin is known, `lcbayes fit --start-from DIR` says; that command is printed.
For asteroids with a few points a night over more than 200 days, periods from 2 to 1000
hours are searched by default, and each solution has a probability.
A run that was stopped goes on when the same command is given again.
""",
    options=ScanOptions,
    fully_lit=True,
)
