"""Options of `lcbayes survey`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from lcbayes.core.options import Options, option
from lcbayes.inversion.attitude_scan.limits import PERIODS_H
from lcbayes.tasks.scan.options import between, check_range
from lcbayes.tasks.task import REQUIRED_FOLDER, Task

# How the work is distributed, and what is written beside the table.
RUNNING = ("full", "time_limit", "scheduler", "workers")


@dataclass(frozen=True)
class SurveyOptions(Options):
    """Options of `lcbayes.survey`."""

    object: str | None = option(
        None, metavar="COLUMN", help="column that names the object of a row; by default recognised"
    )
    columns: str | None = option(
        None,
        metavar="NAME=COLUMN,...",
        help="names of the columns in the table, as mag=V,mag_err=err",
    )
    error: float | None = option(None, metavar="SD", help="one error for all points, mag or flux")
    error_floor: float | None = option(
        None, metavar="SD", help="smallest error, mag or flux; smaller ones are raised to it"
    )
    frame: str | None = option(
        None,
        choices=("icrs", "ecliptic-j2000"),
        help="axes of the directions, where the catalogue does not say",
    )
    period_range: tuple[float, ...] = option(
        PERIODS_H,
        unit="hours",
        parse=between,
        metavar="FROM,TO",
        help="periods to try",
    )
    period_step: float = option(
        0.5, above=0.0, high=1.0, help="step between trial periods, in half turns over the data"
    )
    keep: int = option(12, low=1, high=100, help="largest number of solutions of an object")
    refine: bool = option(False, help="fit a convex body to each of these solutions")
    full: tuple[str, ...] = option(
        (),
        metavar="NAME",
        help="write the complete scan of this object into objects/NAME; may be given several times",
    )
    time_limit: float | None = option(
        None, above=0.0, unit="s", metavar="S", help="largest time of an object, which then failed"
    )
    scheduler: str | None = option(None, metavar="ADDRESS", help="a Dask cluster: tcp://…")
    workers: int | None = option(None, low=1, help="processes; by default one a core")

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range(self.period_range)

    def numbers(self) -> dict[str, Any]:
        """The options that determine the numbers of an object."""
        return {name: value for name, value in self.as_dict().items() if name not in RUNNING}


TASK = Task(
    name="survey",
    details="""\
examples:
  lcbayes survey survey.parquet -o out
  lcbayes survey survey.csv -o out --object designation --columns mag=reduced_mag
  lcbayes survey asteroids/ -o out --time-limit 300 --full 10537
  lcbayes survey 'parts/*.lcs' -o out --scheduler tcp://10.0.0.1:8786

CATALOGUE is a table with the points of all objects (CSV, or Parquet with one row a point
or one row an object with lists), a folder of Parquet files, of DAMIT files or of inputs of
Asteroids@home, or a pattern in quotes. A table has a column that names the object, such as
object, and the columns of a light curve: jd, flux or mag, sun_x .. obs_z.

tables/solutions.parquet and tables/solutions.csv have one row for each object and
solution. The same command again keeps what is done, and tries again what was stopped.

Exit status 3: objects failed, or results must not be trusted; the table says why.
""",
    options=SurveyOptions,
    source="catalogue",
    source_help="CSV, Parquet, folder or pattern",
    out=REQUIRED_FOLDER,
)
