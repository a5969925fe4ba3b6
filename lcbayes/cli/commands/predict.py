"""`lcbayes predict DIR GEOMETRY -o out.csv`: brightness for other epochs."""

from __future__ import annotations

import argparse
import csv
import io
import sys
from pathlib import Path

from lcbayes.cli.commands.reading import check_seed
from lcbayes.core.errors import EXIT_DONE

HELP = "brightness that a fit predicts for the epochs and geometry in a file"
EPILOG = """\
example:
  lcbayes predict out tomorrow.csv -o brightness.csv

The file is a light curve whose brightness may be missing. Columns out: those of
the time and curve, and mag_mean, mag_q05, mag_q25, mag_q75, mag_q95 (or flux_...):
mean, central 50 % and 90 % of what would be recorded, noise included.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", metavar="DIR", type=Path, help="folder of a fit")
    parser.add_argument("geometry", metavar="GEOMETRY", help="file with epochs and geometry")
    parser.add_argument(
        "-o", "--out", metavar="FILE", type=Path, required=True, help="CSV to write"
    )
    parser.add_argument("--tle", metavar="FILE", help="two-line elements of the object")
    parser.add_argument("--site", metavar="LAT,LON,H", help="observer: degrees, degrees, metres")
    parser.add_argument(
        "--seed", type=int, default=0, metavar="N", help="of the noise in the intervals (default 0)"
    )


def run(args: argparse.Namespace) -> int:
    import numpy as np

    from lcbayes.core.files import write_text
    from lcbayes.data.read import read_geometry
    from lcbayes.tasks.predict.run import fitted_curve, load, predict

    check_seed(args)
    posterior, config = load(args.folder)
    fitted = fitted_curve(args.folder)
    wanted = read_geometry(args.geometry, tle=args.tle, site=args.site)
    columns, notes = predict(
        posterior, fitted, wanted, config.keywords["model"], config.options, args.seed
    )
    for note in notes:
        print(f"note: {note}", file=sys.stderr)
    times = (
        {"t": wanted.t} if wanted.epoch_jd is None else {"jd": wanted.epoch_jd + wanted.t / 86400}
    )
    table = {**times, "curve": [wanted.curve_names[i] for i in wanted.curve], **columns}
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(table)
    cells = [np.asarray(column).tolist() for column in table.values()]
    writer.writerows(zip(*cells, strict=True))  # a float is written by repr: shortest exact form
    write_text(text.getvalue(), args.out)
    print(args.out)
    return EXIT_DONE
