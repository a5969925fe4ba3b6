"""`lcbayes single-facet CURVE -o DIR`: orientation of a large facet from an edge in a pass."""

from __future__ import annotations

import argparse

from lcbayes.cli.commands.reading import (
    add_reading_arguments,
    add_result_arguments,
    asked,
    check_seed,
    read_lit,
)
from lcbayes.core.errors import EXIT_DONE, EXIT_NOT_TRUSTED

HELP = "orientation of one large facet from the brightening or dimming where its edge is crossed"
EPILOG = """\
examples:
  lcbayes single-facet pass.csv --tle object.tle -o out
  lcbayes single-facet pass.csv --law inertial -o out

For a pass of a low satellite, from one site or better from two. The normal is
given in the body axes of the law (x along the flight, z to nadir for lvlh).
Written: single_facet.html, single_facet.json, single_facet.txt, figures/.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_reading_arguments(parser)
    add_result_arguments(parser, "single_facet")
    parser.add_argument(
        "--law",
        metavar="LAW[:NAME=NUMBER,...]",
        help="attitude law that holds the facet (default: lvlh with an orbit, else inertial)",
    )


def run(args: argparse.Namespace) -> int:
    check_seed(args)
    curve = read_lit(args)

    from lcbayes.analysis import single_facet_report as report
    from lcbayes.analysis.small_report import tell
    from lcbayes.inversion.separated.single_facet import single_facet
    from lcbayes.physics.attitude import catalogue

    name = args.law or ("inertial" if curve.velocity_km_s is None else "lvlh")
    result = single_facet(curve, catalogue.parse(name), seed=args.seed)
    report.write(result, args.out, asked(args, curve))
    tell(args.out, report.NAME, report.words(result), args.json)
    return EXIT_NOT_TRUSTED if result.reasons else EXIT_DONE
