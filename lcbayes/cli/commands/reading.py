"""The options with which every command reads a light curve."""

from __future__ import annotations

import sys
from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lcbayes.core.errors import InputError
from lcbayes.core.options import declared_options
from lcbayes.data.options import ReadOptions

if TYPE_CHECKING:
    from lcbayes.data.lightcurve import LightCurve


def add_reading_arguments(parser: ArgumentParser, *, optional: bool = False) -> None:
    """Add the light curve and what may have to be said about it."""
    parser.add_argument(
        "curve",
        metavar="CURVE",
        nargs="?" if optional else None,
        help="light curve: CSV, ECSV, DAMIT, MMT-9, SCORE",
    )
    add_reading_options(parser)


def add_reading_options(parser: ArgumentParser) -> None:
    """Add what may have to be said about light curves."""
    parser.add_argument("--format", help="format of the file (default: told from its content)")
    parser.add_argument("--tle", metavar="FILE", help="two-line elements of the object")
    parser.add_argument(
        "--site", metavar="LAT,LON,H", help="observer: degrees north, degrees east, metres"
    )
    parser.add_argument(
        "--error", type=float, metavar="SD", help="one error for all points, instead of the file's"
    )
    parser.add_argument(
        "--error-floor", type=float, metavar="SD", help="raise smaller errors to this one"
    )


def add_result_arguments(
    parser: ArgumentParser, name: str, *, optional: bool = False, seed: bool = True
) -> None:
    """Add the folder of the results, the seed of what is drawn, and --json for ``name``.json."""
    parser.add_argument(
        "-o",
        "--out",
        metavar="DIR",
        type=Path,
        required=not optional,
        help="folder for the results",
    )
    if seed:
        parser.add_argument(
            "--seed", type=int, default=0, metavar="N", help="of all draws (default 0)"
        )
    parser.add_argument("--json", action="store_true", help=f"print {name}.json on standard output")


def asked(args: Namespace, curve: LightCurve) -> dict[str, Any]:
    """What opens the file of a result: the light curve, its frame, and the seed where one is."""
    about = {
        "curve": str(args.curve),
        "sha256": curve.source.get("sha256"),
        "frame": curve.frame,
        "points_in_penumbra_left_out": int(curve.source.get("in_penumbra", 0)),
    }
    return about | ({"seed": args.seed} if "seed" in args else {})


def check_seed(args: Namespace) -> None:
    if args.seed < 0:
        raise InputError(f"--seed is {args.seed}; expected a whole number >= 0")


def read_from(args: Namespace) -> LightCurve:
    """The light curve those options name."""
    from lcbayes.data.read import read

    return read(
        args.curve,
        format=args.format,
        tle=args.tle,
        site=args.site,
        error=args.error,
        error_floor=args.error_floor,
    )


def read_lit(args: Namespace) -> LightCurve:
    """The same without points in the Earth's penumbra, which is said, for methods that take the
    body for fully lit."""
    from lcbayes.data.earth_shadow import FULL, fully_lit

    curve = fully_lit(read_from(args))
    if "in_penumbra" in curve.source:
        n = curve.source["in_penumbra"]
        less = f"less than {100 * FULL:.0f} % of the sunlight past the Earth"
        print(f"note: {n} points that get {less} are left out", file=sys.stderr)
    return curve


def how_read(args: Namespace) -> dict[str, Any]:
    """Those options that were given, to be kept in run.toml."""
    given = {
        k: getattr(args, k) for k in declared_options(ReadOptions) if getattr(args, k) is not None
    }
    if "tle" in given:  # run.toml may be read from another folder
        given["tle"] = str(Path(given["tle"]).resolve())
    return given
