"""Longitudes and latitudes of directions, and circular means of angles."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


def unit_vector(lon: ArrayLike, lat: ArrayLike) -> Floats:
    """Unit vectors (..., 3) of longitudes and latitudes in radians."""
    lon, lat = np.asarray(lon), np.asarray(lat)
    return np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], -1)


def lon_lat_deg(vectors: Floats) -> tuple[Floats, Floats]:
    """Longitude in [0, 360) and latitude, in degrees, of vectors (..., 3) of any length.

    Examples
    --------
    >>> [float(x) for x in lon_lat_deg(np.array([0.0, -2.0, 0.0]))]
    [270.0, 0.0]
    """
    lon = np.degrees(np.arctan2(vectors[..., 1], vectors[..., 0])) % 360.0
    lat = np.degrees(np.arctan2(vectors[..., 2], np.hypot(vectors[..., 0], vectors[..., 1])))
    return lon, lat


def unwrapped(
    values: ArrayLike, period: float, axis: int | tuple[int, ...] | None = None
) -> Floats:
    """Angles shifted by whole turns to lie within half a turn of their circular mean.

    The mean itself lies in [0, period), so that quantiles and means of angles near zero are
    meaningful. Draws that cover the whole circle still span one turn.

    Parameters
    ----------
    values : array
        In the unit of ``period``.
    period : float
        One turn.
    axis : int or tuple of int, optional
        Axes over which the mean is taken: all axes (default) or leading axes.
    """
    angle = 2 * np.pi * np.asarray(values, float) / period
    mean = np.arctan2(np.sin(angle).mean(axis), np.cos(angle).mean(axis))
    offset = (angle - mean + np.pi) % (2 * np.pi) - np.pi
    return (np.mod(mean, 2 * np.pi) + offset) * period / (2 * np.pi)
