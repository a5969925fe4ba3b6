"""`lcbayes single-facet CURVE -o DIR`: orientation of a large facet from an edge in a pass."""

from __future__ import annotations

import argparse
from pathlib import Path

from lcbayes.commands.reading import add_reading_arguments, read_from
from lcbayes.errors import EXIT_DONE, EXIT_NOT_TRUSTED, InputError

HELP = "orientation of one large facet from the brightening or dimming where its edge is crossed"
EPILOG = """\
examples:
  lcbayes single-facet pass.csv --tle object.tle -o out
  lcbayes single-facet pass.csv --law inertial -o out

For a pass of a low satellite, from one site or better from two. The normal is
given in the body axes of the law (x along the flight, z to nadir for lvlh).
Written: single_facet.json, single_facet.txt, figures/.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_reading_arguments(parser)
    parser.add_argument(
        "-o", "--out", metavar="DIR", type=Path, required=True, help="folder for the results"
    )
    parser.add_argument(
        "--law", metavar="LAW[:NAME=NUMBER,...]",
        help="attitude law that holds the facet (default: lvlh with an orbit, else inertial)",
    )  # fmt: skip
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of all draws (default 0)")
    parser.add_argument(
        "--json", action="store_true", help="print single_facet.json on standard output"
    )


def run(args: argparse.Namespace) -> int:
    if args.seed < 0:
        raise InputError(f"--seed is {args.seed}; expected a whole number >= 0")
    curve = read_from(args)

    from lcbayes.analysis import single_facet_report as report
    from lcbayes.analysis.small_report import tell
    from lcbayes.physics import catalogue
    from lcbayes.separated.single_facet import single_facet

    name = args.law or ("inertial" if curve.velocity_km_s is None else "lvlh")
    result = single_facet(curve, catalogue.parse(name), seed=args.seed)
    about = {"curve": str(args.curve), "sha256": curve.source.get("sha256"), "seed": args.seed}
    report.write(result, args.out, about)
    tell(args.out, report.NAME, report.words(result), args.json)
    return EXIT_NOT_TRUSTED if result.reasons else EXIT_DONE
