"""`lcbayes shape-match CURVE -o DIR`: candidate shapes by phase angle and brightness alone."""

from __future__ import annotations

import argparse
from pathlib import Path

from lcbayes.cli.commands.reading import (
    add_reading_arguments,
    add_result_arguments,
    asked,
    check_seed,
    read_lit,
)
from lcbayes.core.errors import EXIT_DONE, EXIT_NOT_TRUSTED, InputError

HELP = "match the distribution of brightness over phase angle to shapes, without an attitude"
EPILOG = """\
examples:
  lcbayes shape-match passes.csv --tle object.tle -o out
  lcbayes shape-match passes.csv -o out --shape cube --shape cylinder --shape model.obj \\
      --r-diff 0.2 --r-spec 0.4 --exponent 50

For tumbling objects seen often: orientations must be as good as random. Shapes are
cube, tetrahedron, cylinder (3:1), sphere, plate, box-wing, rocket-body, or OBJ files.
Size is not used. Written: shape_match.html, shape_match.json, shape_match.txt, figures/.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_reading_arguments(parser)
    add_result_arguments(parser, "shape_match")
    parser.add_argument(
        "--shape",
        action="append",
        metavar="NAME|FILE.obj",
        help="a candidate; may be given several times (default: all built-in shapes)",
    )
    parser.add_argument(
        "--r-diff", type=float, default=0.3, metavar="R", help="diffuse reflectance (default 0.3)"
    )
    parser.add_argument(
        "--r-spec", type=float, default=0.3, metavar="R", help="specular reflectance (default 0.3)"
    )
    parser.add_argument(
        "--exponent",
        type=float,
        default=100.0,
        metavar="N",
        help="of the specular lobe (Blinn-Phong; default 100)",
    )
    parser.add_argument(
        "--level",
        type=float,
        default=0.05,
        metavar="P",
        help="reject candidates below this p-value (default 0.05)",
    )


def run(args: argparse.Namespace) -> int:
    check_seed(args)
    curve = read_lit(args)

    from lcbayes.analysis import shape_match_report as report
    from lcbayes.analysis.small_report import tell
    from lcbayes.core.progress import Console, Silent
    from lcbayes.inversion.separated.shape_match import Surface, candidates, shape_match
    from lcbayes.physics.bodies.shapes import read_obj

    known = candidates()
    bodies = {}
    for name in args.shape or known:
        if name in known:
            bodies[name] = known[name]
        elif Path(name).suffix.lower() == ".obj":
            bodies[Path(name).stem] = read_obj(name)
        else:
            raise InputError(
                f"unknown shape {name!r}; available: {', '.join(known)}, or a file.obj"
            )
    surface = Surface(args.r_diff, args.r_spec, args.exponent)
    result = shape_match(
        curve,
        bodies,
        surface=surface,
        level=args.level,
        seed=args.seed,
        progress=Silent() if args.json else Console(),
    )
    about = asked(args, curve) | {
        "surface": vars(surface),
    }
    report.write(result, args.out, about)
    tell(args.out, report.NAME, report.words(result), args.json)
    return EXIT_NOT_TRUSTED if result.reasons else EXIT_DONE
