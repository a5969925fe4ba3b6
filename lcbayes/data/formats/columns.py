"""Column names of a light-curve file, and the caller's options for reading it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.errors import InputError
from lcbayes.data.formats.table import Table
from lcbayes.geometry.tle import Tle

Floats = NDArray[np.float64]

TIMES = ("utc", "jd", "t")
VECTORS = ("sun_x", "sun_y", "sun_z", "obs_x", "obs_y", "obs_z")
RADEC = ("ra_deg", "dec_deg", "range_km")
ALTAZ = ("altitude_deg", "azimuth_deg", "height_km")
PLACE = ("sat_x_km", "sat_y_km", "sat_z_km")
VELOCITY = ("sat_vx_km_s", "sat_vy_km_s", "sat_vz_km_s")
SITE = ("site_lat_deg", "site_lon_deg", "site_height_m")
BRIGHTNESS = ("flux", "mag")
_PLAIN = ("jd", "mjd", "t", "flux", "mag", "flux_err", "mag_err", "exposure_s")
TEXTS = ("utc", "date", "clock", "curve", "band", "site", "frame", "calibrated")
NUMERIC = frozenset((*_PLAIN, *VECTORS, *RADEC, *ALTAZ, *SITE, *PLACE, *VELOCITY))
KNOWN = (*_PLAIN, *TEXTS, *VECTORS, *RADEC, *ALTAZ, *SITE, *PLACE, *VELOCITY)


@dataclass(frozen=True)
class Options:
    """The caller's additions to the content of a file."""

    tle: str | Tle | None = None  # a file, or elements already read
    site: str | None = None
    error: float | None = None
    error_floor: float | None = None
    geometry_only: bool = False
    brightness_only: bool = False  # accept a file without directions
    columns: Mapping[str, str] = field(default_factory=dict)  # lcbayes name → name in the file

    def __post_init__(self) -> None:
        for name in ("error", "error_floor"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0):
                raise InputError(f"{name} is {value}; give a positive standard deviation")

    def errors(self, given: Floats | None, n: int, name: str) -> Floats | None:
        """The standard deviations of the file, modified by ``error`` and ``error_floor``."""
        if self.geometry_only:
            return None
        if self.error is not None:
            given = np.full(n, self.error)
        if self.error_floor is None:
            return given
        if given is None:
            raise InputError(f"{name} gives no errors that --error-floor could raise; use --error")
        return np.maximum(given, self.error_floor)


def need(table: Table, names: tuple[str, ...]) -> None:
    """Raise InputError unless all the columns are present."""
    missing = [name for name in names if name not in table]
    if missing:
        raise InputError(
            f"{table.file.name} has no column {', '.join(missing)}; expected all of: "
            f"{' '.join(names)}"
        )
