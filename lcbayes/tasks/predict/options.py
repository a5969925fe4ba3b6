"""Options of `lcbayes predict`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from lcbayes.core.options import Options, option
from lcbayes.tasks.task import FILE, Task


@dataclass(frozen=True)
class PredictOptions(Options):
    """Options of `lcbayes.predict`."""

    geometry: Path = option(help="file with epochs and geometry", positional=True)
    tle: Path | None = option(None, metavar="FILE", help="two-line elements of the object")
    site: str | None = option(
        None, metavar="LAT,LON,H", help="observer: degrees north, degrees east, metres"
    )
    model: str | None = option(
        None, metavar="FILE", help="the model file of the fit, where its model is a file"
    )
    seed: int = option(0, low=0, help="seed of the noise in the intervals")


TASK = Task(
    name="predict",
    summary="brightness that a fit predicts for the epochs and geometry in a file",
    details="""\
example:
  lcbayes predict out tomorrow.csv -o brightness.csv

The file is a light curve whose brightness may be missing. Columns out: those of the
time and curve, mag_mean, mag_q05, mag_q25, mag_q75, mag_q95 (or flux_...): mean,
central 50 % and 90 % of what would be recorded, noise included; and trusted, which is
false where the fit must not be trusted (exit status 3).
""",
    options=PredictOptions,
    source="folder",
    source_help="folder of a fit",
    out=FILE,
)
