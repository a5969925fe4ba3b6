"""Reported variables of a fit and the names of their elements."""

from __future__ import annotations

from collections.abc import Collection

CARRIERS = frozenset(
    {
        "normals",
        "omega_unit",
        "period_shift",
        "mode",
        "expected",
        "flux",
        "sun_body",
        "obs_body",
        "log_level",
        "noise_unit",
        "tilt_unit",
        "logit_outlier_share",
        "log_outlier_excess",
        "member_unit",
        "site_unit",
        "zero_point_mean",
        "zero_point_sd",
        "clock_offset_unit",
        "rate_drift_unit",
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
