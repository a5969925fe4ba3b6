"""Options of `lcbayes look`."""

from __future__ import annotations

from dataclasses import dataclass

from lcbayes.core.options import Options, option
from lcbayes.tasks.task import Task


@dataclass(frozen=True)
class LookOptions(Options):
    """Options of `lcbayes.look`."""

    shuffles: int = option(99, low=99, help="permutations of the test for periodicity")
    seed: int = option(0, low=0, help="seed of the permutations")


TASK = Task(
    name="look",
    details="""\
examples:
  lcbayes look pass.csv
  lcbayes look pass.csv --columns mag=V,mag_err=err --tle object.tle --site=-47.06,15.49,490
  lcbayes look 43_Ariadne.lcs -o look

The first command for a new file; it takes seconds. Directions to Sun and observer
are not required. Without -o, the result is only printed.
Written with -o: report.html, summary.json, tables/, figures/, run.toml.
""",
    options=LookOptions,
    geometry=False,
    prints=True,
    out_help="folder for the page, tables and figures",
)
