"""`lcbayes albedo-area CURVE -o DIR`: albedo-area distribution, shape cues, Minkowski shape."""

from __future__ import annotations

import argparse

from lcbayes.cli.commands.attitude_options import (
    add_attitude_arguments,
    attitude_from,
    attitude_settings,
    phased,
)
from lcbayes.cli.commands.reading import (
    add_reading_arguments,
    add_result_arguments,
    asked,
    check_seed,
    read_lit,
)
from lcbayes.core.errors import EXIT_DONE, EXIT_NOT_TRUSTED, InputError

HELP = "albedo-area distribution, shape cues and convex shape of an object of known attitude"
EPILOG = """\
examples:
  lcbayes albedo-area pass.csv --attitude none -o out
  lcbayes albedo-area pass.csv --omega 0,0,0.1 -o out \\
      --material lambertian --material blinn-phong:n=50
  lcbayes albedo-area 43_Ariadne.lcs --pole 253.2,-17.2 --period 5.76198 -o out \\
      --material lommel-seeliger-lambert --smoothness 1

The attitude is taken as known. Each --material is a column: a law with its
parameters but for the reflectance, which is solved for together with the area.
Written: albedo_area.html, albedo_area.json, albedo_area.txt, figures/, shape.obj, shape.ply.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_reading_arguments(parser)
    add_result_arguments(parser, "albedo_area")
    add_attitude_arguments(parser)
    parser.add_argument(
        "--material",
        action="append",
        metavar="LAW[:NAME=VALUE,...]",
        help="a reflecting component; may be given several times (default lambertian)",
    )
    parser.add_argument(
        "--n-normals", type=int, default=400, metavar="N", help="normals of the grid (default 400)"
    )
    parser.add_argument(
        "--smoothness",
        type=float,
        default=0.0,
        metavar="W",
        help="weight of smoothness over the grid; 0 (default) for bodies with edges",
    )
    parser.add_argument(
        "--facet-cost",
        type=float,
        metavar="CHI2",
        help="what a facet must lower chi2 by to be kept (default 3 ln N of the points)",
    )
    parser.add_argument(
        "--albedo", type=float, default=1.0, metavar="A", help="of all facets, for the shape's size"
    )
    parser.add_argument(
        "--bootstrap", type=int, default=100, metavar="N", help="resampled data sets (default 100)"
    )
    parser.add_argument(
        "--nulls",
        type=int,
        default=199,
        metavar="N",
        help="simulated bodies per null of the shape cues (default 199); 0: no cues",
    )


def run(args: argparse.Namespace) -> int:
    attitude = attitude_from(args)
    check_seed(args)
    for name in ("bootstrap", "nulls"):
        if getattr(args, name) < 0:
            raise InputError(f"--{name} is {getattr(args, name)}; expected a whole number >= 0")
    if (args.out / "posterior.nc").exists():
        raise InputError(f"{args.out} holds a fit; give another folder with -o")
    curve = read_lit(args)
    attitude = phased(attitude, curve)

    from lcbayes.analysis import albedo_area_report as report
    from lcbayes.analysis.small_report import tell
    from lcbayes.core.progress import Console, Silent
    from lcbayes.inversion.albedo_area.inversion import invert
    from lcbayes.inversion.albedo_area.kernel import Material

    materials = [Material.parse(text) for text in args.material or ["lambertian"]]
    result = invert(
        curve,
        attitude,
        materials,
        n_normals=args.n_normals,
        smoothness=args.smoothness,
        cost=args.facet_cost,
        albedo=args.albedo,
        n_bootstrap=args.bootstrap,
        n_null=args.nulls,
        seed=args.seed,
        progress=Silent() if args.json else Console(),
    )
    about = {
        **asked(args, curve),
        "attitude": attitude_settings(args, attitude),
        "options": {
            name: getattr(args, name)
            for name in ("n_normals", "smoothness", "facet_cost", "albedo", "bootstrap", "nulls")
        },
    }
    report.write(result, curve, args.out, about)
    tell(args.out, report.NAME, report.words(result, curve), args.json)
    return EXIT_NOT_TRUSTED if result.reasons else EXIT_DONE
