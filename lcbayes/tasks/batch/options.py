"""Options of `lcbayes batch`."""

from __future__ import annotations

from dataclasses import dataclass

from lcbayes.core.options import option
from lcbayes.data.options import ReadOptions
from lcbayes.tasks.fit.options import FitOptions
from lcbayes.tasks.task import REQUIRED_FOLDER, Task


@dataclass(frozen=True)
class BatchOptions(ReadOptions, FitOptions):
    """Options of `lcbayes.batch`: those of `lcbayes.read` and `lcbayes.fit`, as defaults of the
    objects, and the distribution of the work."""

    reports: bool = option(False, help="write the page of every object too")
    scheduler: str | None = option(None, metavar="ADDRESS", help="a Dask cluster: tcp://…")
    workers: int | None = option(None, low=1, help="processes; by default one a core")


TASK = Task(
    name="batch",
    details="""\
examples:
  lcbayes batch night.csv -o night --n-facets 2 --seed 1
  lcbayes batch curves/ -o night --tle objects.tle --reports
  lcbayes batch 'curves/*.ecsv' -o night --scheduler tcp://10.0.0.1:8786

CATALOGUE is a folder, a pattern in quotes, a CSV file with a column 'curve' or a TOML
file with tables [[objects]] that have a key 'curve'. Further columns: name; format tle
site error error_floor average; model sampler seed num_starts and the other options of fit; any
other is an option of the model, such as n_facets or spin. Options given here hold for
objects that do not say otherwise.

Exit status 3: objects failed, or results must not be trusted; tables/objects.csv says
which and why. The same command again does what is not done, and tries again what failed.
""",
    options=BatchOptions,
    source="catalogue",
    source_help="CSV, TOML, folder or pattern",
    out=REQUIRED_FOLDER,
)
