"""Options of `lcbayes predict`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from lcbayes.core.options import Options, option
from lcbayes.tasks.task import FILE, Task


@dataclass(frozen=True)
class PredictOptions(Options):
    """Options of `lcbayes.predict`."""

    geometry: Path | None = option(None, help="file with epochs and geometry", positional=True)
    tle: Path | None = option(None, metavar="FILE", help="two-line elements of the object")
    site: str | None = option(
        None, metavar="LAT,LON,H", help="observer: degrees north, degrees east, metres"
    )
    date: tuple[float, ...] = option(
        (),
        low=0.0,
        unit="days",
        metavar="JD",
        help="predict the rotation angle of an asteroid at this Julian date; may be repeated",
    )
    occultation: Path | None = option(
        None,
        metavar="FILE",
        help="chords of a stellar occultation by an asteroid: its outline over them, size in km",
    )
    num_bodies: int = option(
        200, low=20, help="bodies of each solution that are compared with the chords"
    )
    model: str | None = option(
        None, metavar="FILE", help="the model file of the fit, where its model is a file"
    )
    seed: int = option(0, low=0, help="seed of the noise in the intervals")


TASK = Task(
    name="predict",
    details="""\
examples:
  lcbayes predict out tomorrow.csv -o brightness.csv
  lcbayes predict out --date 2461000.5 --date 2462000.5 -o rotation.csv
  lcbayes predict out --occultation chords.occ -o outline

Brightness: the file is a light curve whose brightness may be missing. Columns out:
those of the time and curve, mag_mean, mag_q05, mag_q25, mag_q75, mag_q95 (or
flux_...): mean, central 50 % and 90 % of what would be recorded, noise included; and
trusted, which is false where the fit must not be trusted (exit status 3).

Rotation: for each date and solution of an asteroid, the rotation angle of spin.txt
with its standard deviation, deg.

Outline: FILE is in the format of ADAM. Size and place are fitted to the chords for
each body of the posterior; -o names a folder for report.html, figures/ and tables/.
""",
    options=PredictOptions,
    source="folder",
    source_help="folder of a fit",
    out=FILE,
    out_help="CSV file; with --occultation a folder",
)
