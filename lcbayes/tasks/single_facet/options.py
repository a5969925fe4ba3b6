"""Options of `lcbayes single-facet`."""

from __future__ import annotations

from dataclasses import dataclass

from lcbayes.core.options import Options, option
from lcbayes.tasks.task import Task


@dataclass(frozen=True)
class SingleFacetOptions(Options):
    """Options of `lcbayes.single_facet`."""

    law: str | None = option(
        None,
        metavar="LAW[:NAME=NUMBER,...]",
        help="attitude law that holds the facet; by default lvlh with an orbit, otherwise inertial",
    )
    seed: int = option(0, low=0, help="seed of the simulated noise")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.law is not None:
            from lcbayes.physics.attitude import catalogue

            catalogue.parse(self.law)


TASK = Task(
    name="single-facet",
    details="""\
examples:
  lcbayes single-facet pass.csv --tle object.tle -o out
  lcbayes single-facet pass.csv --law inertial -o out

For a pass of a low satellite, from one site or better from two. The normal is
given in the body axes of the law (x along the flight, z to nadir for lvlh).
Written: report.html, summary.json, tables/, figures/, run.toml.
""",
    options=SingleFacetOptions,
    fully_lit=True,
)
