"""`lcbayes spin CURVE -o DIR`: sidereal period and pole from how the synodic period varies."""

from __future__ import annotations

import argparse

from lcbayes.cli.commands.reading import (
    add_reading_arguments,
    add_result_arguments,
    asked,
    check_seed,
    read_lit,
)
from lcbayes.core.errors import EXIT_DONE, EXIT_NOT_TRUSTED, InputError

HELP = "sidereal period and pole of a spinning object from its periods alone, without a shape"
EPILOG = """\
examples:
  lcbayes spin passes.csv --tle object.tle -o out
  lcbayes spin passes.csv -o out --json

Several passes of different geometry are needed, each of six cycles or more. Where
the spin is not stable, not rapid enough, or its synodic period not measurably
different from the sidereal one, no pole is given and the exit status is 3.
Written: spin.html, spin.json, spin.txt, figures/.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_reading_arguments(parser)
    add_result_arguments(parser, "spin")
    parser.add_argument(
        "--shuffles",
        type=int,
        default=199,
        metavar="N",
        help="of the test for periodicity (default 199, at least 99)",
    )


def run(args: argparse.Namespace) -> int:
    if args.shuffles < 99:
        raise InputError(f"--shuffles is {args.shuffles}; expected a whole number >= 99")
    check_seed(args)
    curve = read_lit(args)

    from lcbayes.analysis import spin_report as report
    from lcbayes.analysis.small_report import tell
    from lcbayes.core.progress import Console, Silent
    from lcbayes.inversion.spin import estimate

    result = estimate(
        curve,
        n_shuffles=args.shuffles,
        seed=args.seed,
        progress=Silent() if args.json else Console(),
    )
    about = asked(args, curve) | {"n_shuffles": args.shuffles}
    report.write(result, curve, args.out, about)
    tell(args.out, report.NAME, report.words(result, curve), args.json)
    return EXIT_NOT_TRUSTED if result.reasons else EXIT_DONE
