"""Options of `lcbayes attitude-test`."""

from __future__ import annotations

from dataclasses import dataclass

from lcbayes.core.options import Options, option
from lcbayes.tasks.task import Task


@dataclass(frozen=True)
class AttitudeTestOptions(Options):
    """Options of `lcbayes.attitude_test`."""

    law: tuple[str, ...] = option(
        (),
        metavar="LAW[:NAME=NUMBER,...]",
        help="an attitude law, may be given several times; by default all laws of the catalogue "
        "that need no period",
    )
    level: float = option(
        0.01, above=0.0, below=1.0, metavar="P", help="reject laws with a p-value below this one"
    )
    separation: float = option(
        4.0,
        unit="deg",
        above=0.0,
        high=30.0,
        metavar="DEG",
        help="largest angle between directions that count as equal",
    )
    bodies: int = option(
        499, low=19, help="random bodies for the distribution of the statistic under each law"
    )
    seed: int = option(0, low=0, help="seed of the random bodies")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.law:
            from lcbayes.physics.attitude import catalogue

            for law in self.law:
                catalogue.parse(law)


def laws() -> str:
    """The laws of the catalogue with their titles, one per line."""
    from lcbayes.physics.attitude import catalogue

    return "\n".join(f"{law.name:20s} {law.title}" for law in catalogue.LAWS.values())


TASK = Task(
    name="attitude-test",
    details="""\
examples:
  lcbayes attitude-test passes.csv --tle object.tle -o out
  lcbayes attitude-test passes.csv --tle object.tle -o out --law lvlh --law lvlh:yaw_deg=30 \\
      --law orbit-normal-spin:period_s=12.5
  lcbayes attitude-test --list

A law that is not rejected is not thereby proven.
Written: report.html, summary.json, tables/, figures/, run.toml.
""",
    options=AttitudeTestOptions,
    fully_lit=True,
    listing=laws,
)
