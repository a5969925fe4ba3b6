"""`lcbayes glints CURVE -o DIR`: glints, and the facets, cylinder or panels that make them."""

from __future__ import annotations

import argparse

from lcbayes.cli.commands.attitude_options import (
    add_attitude_arguments,
    attitude_from,
    attitude_settings,
    numbers_from,
    phased,
)
from lcbayes.cli.commands.reading import (
    add_reading_arguments,
    add_result_arguments,
    asked,
    read_lit,
)
from lcbayes.core.errors import EXIT_DONE, EXIT_NOT_TRUSTED, InputError

HELP = "find glints and turn them into directions of facets, cylinders or Sun-tracking panels"
EPILOG = """\
examples:
  lcbayes glints pass.csv --tle object.tle -o out
  lcbayes glints pass.csv --omega 0,0,0.08 -o out
  lcbayes glints geo.csv --tle geo.tle --sun-tracking 0,0,1 -o out

Directions are in body axes, which are the inertial axes unless an attitude is given.
Two glints that share a normal make a facet, three whose bisectors have a common
perpendicular a cylinder, two of one offset from the Sun a tracking panel; where none
do, the exit status is 3. Written: glints.html, glints.json, glints.txt, figures/.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_reading_arguments(parser)
    add_result_arguments(parser, "glints", seed=False)
    add_attitude_arguments(parser)
    parser.add_argument(
        "--sun-tracking",
        metavar="X,Y,Z",
        help="ask for panels that follow the Sun about this axis (0,0,1 for a geostationary orbit)",
    )
    parser.add_argument(
        "--alarm",
        type=float,
        default=0.01,
        metavar="P",
        help="chance of a false glint per light curve (default 0.01)",
    )
    parser.add_argument(
        "--longest",
        type=float,
        metavar="S",
        help="longest glint, s (default: while the bisector moves by 6 deg)",
    )


def run(args: argparse.Namespace) -> int:
    if not 0 < args.alarm < 1:
        raise InputError(f"--alarm is {args.alarm:g}; expected a probability between 0 and 1")
    if args.longest is not None and not args.longest > 0:
        raise InputError(f"--longest is {args.longest:g}; expected seconds > 0")
    axis = None
    if args.sun_tracking is not None:
        x, y, z = numbers_from("--sun-tracking", args.sun_tracking, 3, "the frame's axes, as 0,0,1")
        axis = (x, y, z)
        if not any(axis):
            raise InputError("--sun-tracking is 0,0,0; expected an axis, as 0,0,1")
    attitude = attitude_from(args, optional=True)
    curve = read_lit(args)
    attitude = phased(attitude, curve)

    from lcbayes.analysis import glints_report as report
    from lcbayes.analysis.small_report import tell
    from lcbayes.inversion.glints import analyse

    result = analyse(curve, attitude, axis=axis, alarm=args.alarm, longest_s=args.longest)
    about = {
        **asked(args, curve),
        "attitude": attitude_settings(args, attitude),
        "sun_tracking": axis,
        "alarm": args.alarm,
        "longest_s": args.longest,
    }
    report.write(result, curve, args.out, about)
    tell(args.out, report.NAME, report.words(result, curve), args.json)
    return EXIT_NOT_TRUSTED if result.reasons else EXIT_DONE
