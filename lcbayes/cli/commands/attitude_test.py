"""`lcbayes attitude-test CURVE -o DIR`: which attitude laws the measurements allow."""

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

HELP = "test attitude laws by pairs of measurements that each makes alike, without a shape"
EPILOG = """\
examples:
  lcbayes attitude-test passes.csv --tle object.tle -o out
  lcbayes attitude-test passes.csv --tle object.tle -o out --law lvlh --law lvlh:yaw_deg=30 \\
      --law orbit-normal-spin:period_s=12.5
  lcbayes attitude-test --list

Without --law all laws of the catalogue that need no period are tested. Written:
attitude_test.html, attitude_test.json, attitude_test.txt, figures/. A law that is not
rejected is not thereby proven.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_reading_arguments(parser, optional=True)
    add_result_arguments(parser, "attitude_test", optional=True)
    parser.add_argument("--list", action="store_true", help="name the laws and stop")
    parser.add_argument(
        "--law",
        action="append",
        metavar="LAW[:NAME=NUMBER,...]",
        help="an attitude law; may be given several times (default: the catalogue)",
    )
    parser.add_argument(
        "--level",
        type=float,
        default=0.01,
        metavar="P",
        help="reject laws below this p-value (default 0.01)",
    )
    parser.add_argument(
        "--separation",
        type=float,
        default=4.0,
        metavar="DEG",
        help="largest angle between directions that count as alike (default 4)",
    )
    parser.add_argument(
        "--bodies",
        type=int,
        default=499,
        metavar="N",
        help="bodies drawn for the distribution under each law (default 499)",
    )


def run(args: argparse.Namespace) -> int:
    from lcbayes.physics.attitude import catalogue

    if args.list:
        for law in catalogue.LAWS.values():
            print(f"{law.name:20s} {law.title}")
        return EXIT_DONE
    if args.curve is None or args.out is None:
        raise InputError("give a light curve, and a folder for the results with -o DIR")
    check_seed(args)
    laws = [catalogue.parse(text) for text in args.law or ()]
    curve = read_lit(args)

    from lcbayes.analysis import attitude_test_report as report
    from lcbayes.analysis.small_report import tell
    from lcbayes.core.progress import Console, Silent
    from lcbayes.inversion.separated.attitude_test import attitude_test

    result = attitude_test(
        curve,
        laws or [law for law in catalogue.distinct() if not law.spins],
        level=args.level,
        separation_deg=args.separation,
        n_bodies=args.bodies,
        seed=args.seed,
        progress=Silent() if args.json else Console(),
    )
    about = asked(args, curve) | {
        "separation_deg": args.separation,
        "n_bodies": args.bodies,
    }
    report.write(result, args.out, about)
    tell(args.out, report.NAME, report.words(result), args.json)
    return EXIT_NOT_TRUSTED if result.reasons else EXIT_DONE
