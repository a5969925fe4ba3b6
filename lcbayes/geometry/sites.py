"""Observing sites on the WGS84 ellipsoid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lcbayes.core.errors import InputError, RowError

Floats = NDArray[np.float64]

WGS84 = 1  # erfa's number for the ellipsoid


@dataclass(frozen=True)
class Site:
    """Position of the observer relative to the WGS84 ellipsoid; scalars, or (T,) for each time.

    Parameters
    ----------
    lat_deg, lon_deg : geodetic latitude (north) and longitude (east), degrees
    height_m : above the ellipsoid, metres
    """

    lat_deg: ArrayLike
    lon_deg: ArrayLike
    height_m: ArrayLike

    def __post_init__(self) -> None:
        for name, low, high in (
            ("lat_deg", -90.0, 90.0),
            ("lon_deg", -180.0, 360.0),
            ("height_m", -1000.0, 50_000.0),
        ):
            value = np.atleast_1d(np.asarray(getattr(self, name), dtype=float))
            bad = ~((value >= low) & (value <= high))
            if bad.any():
                row = int(np.argmax(bad))
                what = f"has {int(bad.sum())} values outside {low:g} .. {high:g}"
                remedy = "give latitude and longitude in degrees, height in metres"
                raise RowError(f"site_{name}", what, row, value[row], remedy)

    @classmethod
    def parse(cls, text: str) -> Site:
        """A site from "latitude,longitude,height"."""
        try:
            lat, lon, height = (float(part) for part in text.split(","))
        except ValueError:
            raise InputError(
                f"site is {text!r}; expected latitude,longitude,height in degrees (north, east) "
                "and metres, like 43.65,41.431,2030"
            ) from None
        try:
            return cls(lat, lon, height)
        except RowError as fault:
            raise InputError(f"site {text!r}: {fault}") from None

    def itrs(self) -> Floats:
        """Position in ITRS, km, (3,) or (T, 3)."""
        import erfa

        lon, lat = np.radians(self.lon_deg), np.radians(self.lat_deg)
        return erfa.gd2gc(WGS84, lon, lat, np.asarray(self.height_m, dtype=float)) / 1e3

    def axes(self) -> Floats:
        """Unit vectors toward east, north and zenith, ITRS, (3, 3) or (T, 3, 3)."""
        lon, lat = np.radians(self.lon_deg), np.radians(self.lat_deg)
        lon, lat = np.broadcast_arrays(lon, lat)
        sl, cl, sp, cp = np.sin(lon), np.cos(lon), np.sin(lat), np.cos(lat)
        east = np.stack([-sl, cl, np.zeros_like(sl)], -1)
        north = np.stack([-sp * cl, -sp * sl, cp], -1)
        zenith = np.stack([cp * cl, cp * sl, sp], -1)
        return np.stack([east, north, zenith], -2)
