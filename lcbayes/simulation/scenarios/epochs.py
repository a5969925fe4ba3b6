"""Epochs and directions of a scenario's geometry, as a light curve without brightness."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.errors import InputError
from lcbayes.data.lightcurve import LightCurve
from lcbayes.data.read import read_geometry
from lcbayes.geometry.directions import from_tle
from lcbayes.geometry.earth import Earth, sun_position
from lcbayes.geometry.sites import Site
from lcbayes.geometry.times import Times
from lcbayes.geometry.tle import Tle
from lcbayes.simulation.scenarios.viewing import Orbit, OrbitPass, Planar, PlanarPass, Vectors

Floats = NDArray[np.float64]

JD_OF_1970 = 2440587.5


def epochs(geometry: Planar | Orbit | Vectors) -> LightCurve:
    """Epochs and directions of a geometry; the brightness is NaN throughout.

    Raises
    ------
    InputError
        If a file is invalid, or no epoch of a pass is observable.
    """
    if isinstance(geometry, Planar):
        return _planar(geometry)
    if isinstance(geometry, Orbit):
        return _orbit(geometry)
    return read_geometry(geometry.file)


def _grid(start: float, stop: float, step: float) -> Floats:
    """start, start + step, ... up to and including stop."""
    count = int(np.floor((stop - start) / step * (1 + 1e-12))) + 1
    return start + step * np.arange(count, dtype=np.float64)


def _planar(geometry: Planar) -> LightCurve:
    parts = [_planar_pass(one) for one in geometry.passes]
    t, sun, obs = (np.concatenate(column) for column in zip(*parts, strict=True))
    order = np.argsort(t, kind="stable")
    return LightCurve(
        t=t[order],
        brightness=np.full(t.size, np.nan),
        error=None,
        sun=sun[order],
        obs=obs[order],
        range_km=None if geometry.range_km is None else np.full(t.size, geometry.range_km),
        frame=geometry.frame,
    )


def _planar_pass(one: PlanarPass) -> tuple[Floats, Floats, Floats]:
    t = _grid(one.start, one.stop, one.step)
    sun = _turning(t, one.omega_sun, one.lambda_sun)
    turn = {"xy": 0, "yz": 1, "zx": 2}[one.plane]
    obs = np.roll(_turning(t, one.omega_obs, one.lambda_obs), turn, axis=1)
    return t, sun, obs


def _turning(t: Floats, rate: float, start: float) -> Floats:
    angle = rate * t + start
    return np.stack([np.cos(angle), np.sin(angle), np.zeros_like(t)], axis=1)


def _orbit(geometry: Orbit) -> LightCurve:
    passes = [_usable(geometry.tle, one) for one in geometry.passes]
    zero = min(begin for begin, _, _ in passes)
    t = np.concatenate([(begin - zero).total_seconds() + dt for begin, dt, _ in passes])
    order = np.argsort(t, kind="stable")
    names = [one.site.name for one in geometry.passes]
    sizes = [dt.size for _, dt, _ in passes]

    def joined(name: str) -> Floats:
        return np.concatenate([getattr(seen, name) for _, _, seen in passes])[order]

    return LightCurve(
        t=t[order],
        brightness=np.full(t.size, np.nan),
        error=None,
        sun=joined("sun"),
        obs=joined("obs"),
        range_km=joined("range_km"),
        position_km=joined("position_km"),
        velocity_km_s=joined("velocity_km_s"),
        site=np.repeat(np.array(names), sizes)[order],
        epoch_jd=_julian_date(zero),
        frame="icrs",
    )


class _Seen(NamedTuple):
    sun: Floats
    obs: Floats
    range_km: Floats
    position_km: Floats
    velocity_km_s: Floats


def _usable(tle: Tle, one: OrbitPass) -> tuple[datetime, Floats, _Seen]:
    """The first observable instant of a pass, seconds since then, and the geometry.

    A satellite is observable if it is high enough and in full sunlight and the site is dark enough.
    """
    dt = _grid(0.0, (one.stop - one.start).total_seconds(), one.step)
    time = Times.of(_julian_date(one.start), dt)
    site = Site(one.site.lat_deg, one.site.lon_deg, one.site.height_m)
    seen = from_tle(time, site, tle)
    sun = sun_position(time)
    zenith = Earth(time).to_gcrs(site.axes()[2])
    sun_altitude = np.degrees(np.arcsin(np.sum(sun * zenith, -1) / np.linalg.norm(sun, axis=-1)))
    low = seen.altitude_deg < one.min_elevation_deg
    shaded = ~seen.sunlit
    bright = sun_altitude > one.max_sun_elevation_deg
    kept = np.flatnonzero(~(low | shaded | bright))
    if kept.size == 0:
        raise InputError(
            f"no epoch from {one.start:%Y-%m-%dT%H:%M:%S} to {one.stop:%Y-%m-%dT%H:%M:%S} can be "
            f"observed: of {dt.size}, {low.sum()} are below {one.min_elevation_deg:g} deg, "
            f"{shaded.sum()} in the Earth's shadow, {bright.sum()} with the Sun above "
            f"{one.max_sun_elevation_deg:g} deg; choose another start and stop"
        )
    begin = float(dt[kept[0]])
    directions = _Seen(*(getattr(seen, name)[kept] for name in _Seen._fields))
    return one.start + timedelta(seconds=begin), dt[kept] - begin, directions


def _julian_date(instant: datetime) -> float:
    return JD_OF_1970 + (instant - datetime(1970, 1, 1, tzinfo=UTC)) / timedelta(days=1)
