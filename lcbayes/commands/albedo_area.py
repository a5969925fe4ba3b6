"""`lcbayes albedo-area CURVE -o DIR`: albedo-area distribution, shape cues, Minkowski shape."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from lcbayes.commands.reading import (
    add_reading_arguments,
    add_result_arguments,
    asked,
    check_seed,
    read_from,
)
from lcbayes.errors import EXIT_DONE, EXIT_NOT_TRUSTED, InputError

if TYPE_CHECKING:
    from lcbayes.albedo_area.observed import Attitude

HELP = "albedo-area distribution, shape cues and convex shape of an object of known attitude"
EPILOG = """\
examples:
  lcbayes albedo-area pass.csv --attitude none -o out
  lcbayes albedo-area pass.csv --omega 0,0,0.1 -o out
      --material lambertian --material blinn-phong:n=50
  lcbayes albedo-area 43_Ariadne.lcs --pole 253.2,-17.2 --period 5.76198 -o out
      --material lommel-seeliger-lambert --smoothness 1

The attitude is taken as known. Each --material is a column: a law with its
parameters but for the reflectance, which is solved for together with the area.
Written: albedo_area.json, albedo_area.txt, figures/, shape.obj, shape.ply.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_reading_arguments(parser)
    add_result_arguments(parser, "albedo_area")
    add_attitude_arguments(parser)
    parser.add_argument(
        "--material", action="append", metavar="LAW[:NAME=VALUE,...]",
        help="a reflecting component; may be given several times (default lambertian)",
    )  # fmt: skip
    parser.add_argument(
        "--n-normals", type=int, default=400, metavar="N", help="normals of the grid (default 400)"
    )
    parser.add_argument(
        "--smoothness", type=float, default=0.0, metavar="W",
        help="weight of smoothness over the grid; 0 (default) for bodies with edges",
    )  # fmt: skip
    parser.add_argument(
        "--facet-cost", type=float, metavar="CHI2",
        help="what a facet must lower chi2 by to be kept (default 3 ln N of the points)",
    )  # fmt: skip
    parser.add_argument(
        "--albedo", type=float, default=1.0, metavar="A", help="of all facets, for the shape's size"
    )
    parser.add_argument(
        "--bootstrap", type=int, default=100, metavar="N", help="resampled data sets (default 100)"
    )
    parser.add_argument(
        "--nulls", type=int, default=199, metavar="N",
        help="simulated bodies per null of the shape cues (default 199); 0: no cues",
    )  # fmt: skip


def add_attitude_arguments(parser: argparse.ArgumentParser) -> None:
    """The attitude that is taken as known."""
    parser.add_argument(
        "--attitude", choices=("none",), help="none: the body axes are the inertial axes"
    )
    parser.add_argument(
        "--omega", metavar="X,Y,Z", help="constant angular velocity, rad/s (--omega=-1,0,0)"
    )
    parser.add_argument("--pole", metavar="LON,LAT", help="pole of the spin, degrees")
    parser.add_argument("--period", type=float, metavar="HOURS", help="sidereal period of the spin")


def run(args: argparse.Namespace) -> int:
    attitude = attitude_from(args)
    check_seed(args)
    for name in ("bootstrap", "nulls"):
        if getattr(args, name) < 0:
            raise InputError(f"--{name} is {getattr(args, name)}; expected a whole number >= 0")
    if (args.out / "posterior.nc").exists():
        raise InputError(f"{args.out} holds a fit; give another folder with -o")
    curve = read_from(args)

    from lcbayes.albedo_area.inversion import invert
    from lcbayes.albedo_area.kernel import Material
    from lcbayes.analysis import albedo_area_report as report
    from lcbayes.analysis.small_report import tell
    from lcbayes.progress import Console, Silent

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
        "frame": curve.frame,
        "attitude": {k: v for k, v in vars(attitude).items() if v is not None},
        "options": {
            name: getattr(args, name)
            for name in ("n_normals", "smoothness", "facet_cost", "albedo", "bootstrap", "nulls")
        },
    }
    report.write(result, curve, args.out, about)
    tell(args.out, report.NAME, report.words(result, curve), args.json)
    return EXIT_NOT_TRUSTED if result.reasons else EXIT_DONE


def attitude_from(args: argparse.Namespace, *, optional: bool = False) -> Attitude:
    """The attitude those options name; fixed axes where none is given and none need be."""
    given = [n for n in ("attitude", "omega", "pole") if getattr(args, n) is not None]
    if len(given) != 1 and (given or not optional):
        how = " and ".join(f"--{n}" for n in given) + " are given" if given else "none is given"
        raise InputError(
            f"one attitude is needed, and {how}; give --pole LON,LAT with --period HOURS, "
            "--omega X,Y,Z, or --attitude none"
        )
    if (args.pole is None) != (args.period is None):
        raise InputError("a spin needs both --pole LON,LAT and --period HOURS")
    from lcbayes.albedo_area.observed import Attitude

    if args.omega is not None:
        x, y, z = numbers_from("--omega", args.omega, 3, "rad/s, as 0,0,0.1")
        return Attitude(omega=(x, y, z))
    if args.pole is not None:
        lon, lat = numbers_from("--pole", args.pole, 2, "degrees, as 253.2,-17.2")
        return Attitude(pole_lon_deg=lon, pole_lat_deg=lat, period_h=args.period)
    return Attitude()


def numbers_from(option: str, text: str, count: int, unit: str) -> list[float]:
    """So many numbers of an option, separated by commas."""
    try:
        values = [float(x) for x in text.split(",")]
    except ValueError:
        values = []
    if len(values) != count:
        raise InputError(f"{option} is {text!r}; expected {count} numbers in {unit}")
    return values
