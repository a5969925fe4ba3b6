"""`lcbayes spin CURVE -o DIR`: sidereal period and pole from how the synodic period varies."""

from __future__ import annotations

import argparse
from pathlib import Path

from lcbayes.commands.reading import add_reading_arguments, read_from
from lcbayes.errors import EXIT_DONE, EXIT_NOT_TRUSTED, InputError

HELP = "sidereal period and pole of a spinning object from its periods alone, without a shape"
EPILOG = """\
examples:
  lcbayes spin passes.csv --tle object.tle -o out
  lcbayes spin passes.csv -o out --json

Several passes of different geometry are needed, each of six cycles or more. Where
the spin is not stable, not rapid enough, or its synodic period not measurably
different from the sidereal one, no pole is given and the exit status is 3.
Written: spin.json, spin.txt, figures/.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_reading_arguments(parser)
    parser.add_argument(
        "-o", "--out", metavar="DIR", type=Path, required=True, help="folder for the results"
    )
    parser.add_argument(
        "--shuffles", type=int, default=199, metavar="N",
        help="of the test for periodicity (default 199, at least 99)",
    )  # fmt: skip
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of all draws (default 0)")
    parser.add_argument("--json", action="store_true", help="print spin.json on standard output")


def run(args: argparse.Namespace) -> int:
    for name, least in (("shuffles", 99), ("seed", 0)):
        if getattr(args, name) < least:
            raise InputError(
                f"--{name} is {getattr(args, name)}; expected a whole number >= {least}"
            )
    curve = read_from(args)

    from lcbayes.analysis import spin_report as report
    from lcbayes.analysis.small_report import tell
    from lcbayes.progress import Console, Silent
    from lcbayes.spin import estimate

    result = estimate(
        curve,
        n_shuffles=args.shuffles,
        seed=args.seed,
        progress=Silent() if args.json else Console(),
    )
    about = {
        "curve": str(args.curve),
        "sha256": curve.source.get("sha256"),
        "frame": curve.frame,
        "n_shuffles": args.shuffles,
        "seed": args.seed,
    }
    report.write(result, curve, args.out, about)
    tell(args.out, report.NAME, report.words(result, curve), args.json)
    return EXIT_NOT_TRUSTED if result.reasons else EXIT_DONE
