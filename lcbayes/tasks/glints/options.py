"""Options of `lcbayes glints`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from lcbayes.core.errors import InputError
from lcbayes.core.options import option
from lcbayes.tasks.attitude import AttitudeOptions
from lcbayes.tasks.task import Task


@dataclass(frozen=True)
class GlintsOptions(AttitudeOptions):
    """Options of `lcbayes.glints`."""

    attitude_required: ClassVar[bool] = False

    sun_tracking: tuple[float, float, float] | None = option(
        None,
        metavar="X,Y,Z",
        help="look for panels that follow the Sun about this axis, inertial axes; 0,0,1 in a "
        "geostationary orbit",
    )
    alarm: float = option(
        0.01, above=0.0, below=1.0, metavar="P", help="probability of a false glint in the curve"
    )
    longest: float | None = option(
        None,
        unit="s",
        above=0.0,
        metavar="S",
        help="longest glint to look for; by default the time in which the bisector moves by 6 deg",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.sun_tracking is not None and not any(self.sun_tracking):
            raise InputError("--sun-tracking is 0,0,0; expected an axis, as 0,0,1")


TASK = Task(
    name="glints",
    details="""\
examples:
  lcbayes glints pass.csv --tle object.tle -o out
  lcbayes glints pass.csv --omega 0,0,0.08 -o out
  lcbayes glints geo.csv --tle geo.tle --sun-tracking 0,0,1 -o out

Directions are in body axes, which are the inertial axes unless an attitude is given.
Two glints that share a normal make a facet, three whose bisectors have a common
perpendicular a cylinder, two of one offset from the Sun a tracking panel. Where none
do, the exit status is 3.
Written: report.html, summary.json, tables/, figures/, run.toml.
""",
    options=GlintsOptions,
    fully_lit=True,
)
