"""Options of `lcbayes convert`; in Python, use `lcbayes.read` and `lcbayes.write`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from lcbayes.core.errors import InputError
from lcbayes.core.options import Options, option
from lcbayes.tasks.task import TEXT, Task

SUFFIXES = (".csv", ".ecsv")


@dataclass(frozen=True)
class ConvertOptions(Options):
    """Options of `lcbayes convert`."""

    output: Path = option(positional=True, metavar="OUT", help="file to write, .csv or .ecsv")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.output.suffix.lower() not in SUFFIXES:
            raise InputError(
                f"OUT is {str(self.output)!r}; expected a name ending in .csv or .ecsv"
            )


TASK = Task(
    name="convert",
    details="""\
examples:
  lcbayes convert 43_Ariadne.lcs ariadne.csv
  lcbayes convert pass.csv pass.ecsv --tle object.tle
""",
    options=ConvertOptions,
    out=TEXT,
)
