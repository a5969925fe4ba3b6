"""The options with which a command is told the attitude of the object."""

from __future__ import annotations

import argparse
import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from lcbayes.core.constants import HOUR_S
from lcbayes.core.errors import InputError

if TYPE_CHECKING:
    from lcbayes.data.lightcurve import LightCurve
    from lcbayes.physics.attitude.laws import Attitude


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
    from lcbayes.physics.attitude.laws import ConstantRate, Fixed, PrincipalAxis

    if args.omega is not None:
        x, y, z = numbers_from("--omega", args.omega, 3, "rad/s, as 0,0,0.1")
        return ConstantRate((x, y, z))
    if args.pole is not None:
        lon, lat = numbers_from("--pole", args.pole, 2, "degrees, as 253.2,-17.2")
        return PrincipalAxis(lon, lat, HOUR_S * args.period)
    return Fixed()


def phased(attitude: Attitude, curve: LightCurve) -> Attitude:
    """The attitude with the phase of a spin counted from the middle of the data."""
    from lcbayes.physics.attitude.laws import PrincipalAxis

    if not isinstance(attitude, PrincipalAxis):
        return attitude
    return replace(attitude, t0_s=0.5 * float(curve.t.max() - curve.t.min()))


def attitude_settings(args: argparse.Namespace, attitude: Attitude) -> dict[str, Any]:
    """The attitude as a results file has it."""
    from lcbayes.physics.attitude.laws import ConstantRate, PrincipalAxis

    if isinstance(attitude, ConstantRate):
        return {"omega": attitude.omega_rad_s}
    if isinstance(attitude, PrincipalAxis):
        lon, lat = attitude.pole_lon_deg, attitude.pole_lat_deg
        return {"pole_lon_deg": lon, "pole_lat_deg": lat, "period_h": args.period}
    return {}


def numbers_from(option: str, text: str, count: int, unit: str) -> list[float]:
    """So many numbers of an option, separated by commas."""
    try:
        values = [float(x) for x in text.split(",")]
    except ValueError:
        values = []
    if len(values) != count or not all(map(math.isfinite, values)):
        raise InputError(f"{option} is {text!r}; expected {count} numbers in {unit}")
    return values
