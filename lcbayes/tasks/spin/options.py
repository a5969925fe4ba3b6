"""Options of `lcbayes spin`."""

from __future__ import annotations

from dataclasses import dataclass

from lcbayes.core.options import Options, option
from lcbayes.tasks.task import Task


@dataclass(frozen=True)
class SpinOptions(Options):
    """Options of `lcbayes.spin`."""

    shuffles: int = option(199, low=99, help="permutations of the test for periodicity")
    seed: int = option(0, low=0, help="seed of the permutations")


TASK = Task(
    name="spin",
    details="""\
examples:
  lcbayes spin passes.csv --tle object.tle -o out
  lcbayes spin passes.csv -o out --json

Several passes of different geometry are needed, each of six cycles or more. Where
the spin is not stable, not rapid enough, or its synodic period not measurably
different from the sidereal one, no pole is given and the exit status is 3.
`lcbayes fit --start-from DIR` goes on from the periods; the command is printed.
Written: report.html, summary.json, tables/, figures/, run.toml.
""",
    options=SpinOptions,
    fully_lit=True,
)
