"""Reported variables of a fit and the names of their elements."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
import xarray as xr

# Axes with names as coordinates
GROUPS = ("observer", "calibration", "series", "curve", "phase_law", "ellipsoid")
CARRIERS = frozenset(
    {
        "normals",
        "inertia",
        "omega_unit",
        "period_shift",
        "mode",
        "expected",
        "flux",
        "sun_body",
        "obs_body",
        "lit_and_seen",
        "log_level",
        "noise_unit",
        "tilt_unit",
        "logit_outlier_share",
        "log_outlier_excess",
        "member_unit",
        "site_unit",
        "zero_point_mean",
        "zero_point_sd",
        "zero_point_slope",
        "zero_point_night",
        "zero_point_share",
        "zero_point_series",
        "zero_point_series_mean",
        "zero_point_series_sd",
        "nutation",
        "nutation_mean",
        "nutation_root",
        "nutation_response",
        "nutation_ratio_unit",
        "calibration_sd_unit",
        "series_sd_unit",
        "clock_offset_unit",
        "rate_drift_unit",
        "rate_unit",
        "r_sum",
        "specular_share",
    }
)

SPIN = (
    "pole_lon_deg",
    "pole_lat_deg",
    "period_h",
    "omega_x_rad_s",
    "omega_y_rad_s",
    "omega_z_rad_s",
)


def reported(names: Collection[str]) -> list[str]:
    """The variables to report, without auxiliary ones from which others are computed."""
    return [
        n
        for n in names
        if n not in CARRIERS
        and not n.endswith(("_base", "_held", "_free", "_shared"))
        and not (n.startswith("log_") and n[4:] in names)
    ]


def label(name: str, index: tuple[int, ...]) -> str:
    """Name of one element in `summary.json`: ``phi[0]``, ``omega_x_rad_s``, ``sigma``."""
    if not index:
        return name
    if name == "omega":
        return f"omega_{'xyz'[index[0]]}_rad_s"
    return f"{name}[{','.join(map(str, index))}]"


def named(element: str, draws: xr.Dataset) -> str:
    """The label of an element with the name of its group, if it has one: ``clock_offset[B]``."""
    name, bracket, index = element.rstrip("]").partition("[")
    axes = [d for d in draws[name].dims if d in GROUPS] if bracket and name in draws else []
    names = draws[axes[0]].to_numpy() if axes else np.zeros(0, int)
    return element if names.dtype.kind in "iu" else f"{name}[{names[int(index)]}]"


UNITS = {
    "phi": "rad",
    "omega": "rad/s",
    "phase_d": "rad",
    "phase_k": "1/rad",
    "period_h": "h",
    "extinction": "mag",
    "zero_point": "mag",
    "series_zero_point": "mag",
    "calibration_sd": "mag",
    "series_sd": "mag",
    "clock_offset": "s",
}
ENDINGS = {
    "_deg": "deg",
    "_deg_s": "deg/s",
    "_rad_s": "rad/s",
    "_km_s": "km/s",
    "_h": "h",
    "_s": "s",
    "_m2": "m2",
    "_km": "km",
}
OFFSETS = ("member_", "site_", "pass_")  # of brightness, mag
NOISE = ("sigma", "noise")
BRIGHTNESS = ("brightness", "expected", "error")  # of the light curve


def albedo_area(material: str) -> str:
    """The variable of the albedo-area of a material of a known body."""
    return f"{material}_albedo_area"


def is_albedo_area(name: str) -> bool:
    """Whether a variable is an albedo-area of facets or of a material."""
    return name.endswith("albedo_area") and not name.startswith("log_")


def is_area(name: str) -> bool:
    """Whether a variable is an area or albedo-area."""
    return name == "area" or is_albedo_area(name)


def unit(name: str, *, relative: bool, magnitude: bool) -> str:
    """Unit of a variable of a posterior or light curve; "1" if it is a pure number.

    Parameters
    ----------
    name : name of the variable
    relative : whether all scales of the light curve are unknown, so that areas have no unit
    magnitude : whether the brightness is in magnitudes; the noise of fluxes is relative
    """
    if name in BRIGHTNESS:
        return "mag" if magnitude else "1" if relative else "m2"
    if is_area(name):
        return "1" if relative else "m2"
    if name in NOISE:
        return "mag" if magnitude else "1"
    if name.startswith(OFFSETS) and name.endswith(("_sd", "_offset")):
        return "mag"
    ending = next((u for end, u in ENDINGS.items() if name.endswith(end)), "1")
    return "1" if name.startswith("log_") else UNITS.get(name, ending)
