"""Measurements reduced to unit distance, and their passes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.errors import InputError
from lcbayes.data import segments
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.albedo_area.observed import Observed
from lcbayes.physics.attitude.laws import Attitude, Ephemeris, Fixed

Floats = NDArray[np.float64]
Ints = NDArray[np.integer]


@dataclass(frozen=True)
class Reduced:
    """Data for methods without inversion, with points in order of pass and time.

    Attributes
    ----------
    t : (T,) s
    flux, error : (T,)
        At unit distance under unit irradiance (m²); in any unit for curves of unknown scale.
    sun, obs : (T, 3)
        Unit vectors, inertial.
    one_pass : (T,) int
        Pass of one curve, site and band, `lcbayes.data.segments.PASS`.
    group : (T,) int
        Points of comparable brightness: of one band, and of one curve if its scale is free.
    row : (T,) int
        Index of the point in the light curve.
    """

    t: Floats
    flux: Floats
    error: Floats
    sun: Floats
    obs: Floats
    one_pass: Ints
    group: Ints
    row: Ints

    def at(self, rows: Ints) -> Reduced:
        """The selected points, in that order."""
        return Reduced(**{name: values[rows] for name, values in vars(self).items()})


def reduce(curve: LightCurve) -> Reduced:
    """Linear flux at unit distance, pass by pass.

    Raises
    ------
    InputError
        There is no brightness, or it has no errors, which are required for comparisons.
    """
    if curve.error is None:
        raise InputError(
            "the light curve gives no errors, so that noise cannot be distinguished from a "
            "change; give flux_err or mag_err, or one for all points with --error"
        )
    seen = Observed.of(curve, Fixed())
    label = _numbered(curve.curve, curve.site, curve.band)
    passes = segments.split(curve.t, label)
    order = np.concatenate(passes)
    loose = np.where(curve.free_scale[curve.curve], curve.curve, -1)
    return Reduced(
        curve.t[order],
        seen.flux[order],
        seen.error[order],
        curve.sun[order],
        curve.obs[order],
        np.repeat(np.arange(len(passes)), [rows.size for rows in passes]),
        _numbered(loose, curve.band)[order],
        order,
    )


def turns(law: Attitude, eph: Ephemeris, seen: Reduced) -> list[Floats]:
    """Axes (T, 3, 3) of the body at each point and, if the law has one, of its array.

    ``eph`` is that of the whole light curve, so that a law is compiled for one length only.
    """
    return [np.asarray(x)[seen.row] for x in law.frames(eph) if x is not None]


def in_body(axes: Sequence[Floats], seen: Reduced) -> list[tuple[Floats, Floats]]:
    """Directions to Sun and observer, (T, 3) each, in each of these frames."""
    return [
        (np.einsum("tij,ti->tj", a, seen.sun), np.einsum("tij,ti->tj", a, seen.obs)) for a in axes
    ]


def _numbered(*columns: NDArray) -> Ints:
    """Index of the combination of values in each row, (T,)."""
    text = np.stack([np.asarray(c).astype(str) for c in columns], axis=1)
    return np.unique(text, axis=0, return_inverse=True)[1].ravel()
