"""Options of `lcbayes observability`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from lcbayes.core.errors import InputError
from lcbayes.core.options import Options, option
from lcbayes.tasks.task import Task

TARGETS = "pole, a group, normal:I for facet I, the name of a parameter, or all"


def groups(text: str) -> tuple[str, ...]:
    """Names separated by commas."""
    return tuple(name.strip() for name in text.split(","))


@dataclass(frozen=True)
class ObservabilityOptions(Options):
    """Options of `lcbayes.observability`."""

    unknown: tuple[str, ...] = option(
        ("spin", "normals", "areas", "surface"),
        metavar="GROUP,...",
        parse=groups,
        help="groups of unknown parameters: attitude, spin, normals, areas, surface",
    )
    plan: int | None = option(None, low=1, help="number of visits to choose, the best first")
    target: str = option("pole", help=f"what the plan is to determine: {TARGETS}")
    criterion: str = option(
        "A", choices=("A", "D"), help="A: least mean variance; D: most information"
    )
    visit: float = option(
        0.0, unit="s", low=0.0, metavar="SECONDS", help="length of a visit; 0: single measurements"
    )
    posterior: Path | None = option(
        None, metavar="DIR", help="folder of an earlier fit, whose draws the plan starts from"
    )
    model: str | None = option(
        None, metavar="FILE", help="the model file of that fit, where its model is a file"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.posterior is not None and self.plan is None:
            raise InputError("--posterior is for planning; say how many visits with --plan N")


TASK = Task(
    name="observability",
    details="""\
examples:
  lcbayes observability box-wing -o out
  lcbayes observability mine.toml -o out --unknown attitude,spin
  lcbayes observability mine.toml -o out --plan 20 --target pole --visit 30
  lcbayes observability tomorrow.toml -o out --plan 20 --target normal:2 --posterior fit

The epochs that can be observed are those of the scenario's geometry: for orbits,
where the satellite is high enough and sunlit and the site is dark.
Written: report.html, summary.json, observability.json, tables/ (with --plan also
schedule.csv), figures/, run.toml.
""",
    options=ObservabilityOptions,
    source="scenario",
    source_help="a TOML file, or a name from lcbayes simulate --list",
)
