"""Options of `lcbayes simulate`."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass

from lcbayes.core.options import Options, option
from lcbayes.tasks.task import FILE, Task


@dataclass(frozen=True)
class SimulateOptions(Options):
    """Options of `lcbayes.simulate`."""

    seed: int = option(0, low=0, help="seed of the noise")


def scenarios() -> str:
    """The bundled scenarios with their titles, one per line."""
    from lcbayes.simulation.scenarios import bundled

    titles = {
        name: tomllib.loads(path.read_text(encoding="utf-8")).get("title", "")
        for name, path in bundled().items()
    }
    return "\n".join(f"{name:18s} {title}" for name, title in titles.items())


TASK = Task(
    name="simulate",
    details="""\
examples:
  lcbayes simulate --list
  lcbayes simulate box-wing -o box-wing.csv --seed 1

Written: the light curve, and the truth beside it (box-wing.truth.json).
""",
    options=SimulateOptions,
    source="scenario",
    source_help="a TOML file, or the name of a bundled scenario, which --list shows",
    out=FILE,
    out_help="file for the light curve, .csv or .ecsv",
    listing=scenarios,
)
