"""Directions from glints: facets, cylinders, and panels that follow the Sun.

At a glint, the normal of a facet points along the phase-angle bisector, n·b = 1 (Hall et al. 2007,
eq. 17). The axis of a cylinder is perpendicular to the bisector, c·b = 0 (eq. 18).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from lcbayes.core.constants import SUN_ANGULAR_RADIUS
from lcbayes.physics.bodies.facets import across

Floats = NDArray[np.float64]

CHI2_90 = float(stats.chi2.ppf(0.9, 2))
ACROSS = 1.5  # offset across the track, in widths (sd) of the lobe, at which a facet still glints


@dataclass(frozen=True)
class Sighting:
    """The bisector at a glint.

    Attributes
    ----------
    bisector : (3,)
    rate : (3,) rad/s
        Rate of change of the bisector, perpendicular to it.
    t_error, fwhm : s
    """

    bisector: Floats
    rate: Floats
    t_error: float
    fwhm: float

    @property
    def along(self) -> Floats:
        """Unit vector along the bisector's track."""
        speed = float(np.linalg.norm(self.rate))
        if speed > 0:
            return self.rate / speed
        return across(self.bisector)[0]

    def errors(self) -> tuple[float, float]:
        """Errors of a facet's normal along and across the track, rad.

        The error along the track follows from the time of the peak. Across the track, only the
        detection of a glint is known, so the error is 1.5 standard deviations of the lobe. A
        quarter of the Sun's angular radius is added to both in quadrature.
        """
        speed = float(np.linalg.norm(self.rate))
        disc = 0.25 * SUN_ANGULAR_RADIUS
        lobe = speed * self.fwhm / 2.355
        return float(np.hypot(speed * self.t_error, disc)), float(np.hypot(ACROSS * lobe, disc))


@dataclass(frozen=True)
class Direction:
    """A direction with its uncertainty.

    Attributes
    ----------
    vector : (3,)
        Unit vector; for an axis the opposite vector is equivalent.
    covariance : (3, 3)
        Covariance of the vector in its tangent plane, rad².
    chi2, freedom : χ² of the glints about the direction, and degrees of freedom
    members : indices of the glints
    """

    vector: Floats
    covariance: Floats
    chi2: float
    freedom: int
    members: tuple[int, ...]

    @property
    def p_value(self) -> float:
        """Probability of a larger χ²; 1 without degrees of freedom."""
        return float(stats.chi2.sf(self.chi2, self.freedom)) if self.freedom > 0 else 1.0

    @property
    def ellipse(self) -> tuple[float, float]:
        """Semi-axes of the 90 % region, rad, the longer first."""
        values = np.linalg.eigvalsh(self.covariance)[-2:][::-1]
        longer, shorter = np.sqrt(CHI2_90 * np.maximum(values, 0.0))
        return float(longer), float(shorter)

    def holds(self, vector: Floats, axis: bool = False) -> bool:
        """Whether a direction lies in the 90 % region."""
        v = np.asarray(vector) / np.linalg.norm(vector)
        if axis and v @ self.vector < 0:
            v = -v
        if v @ self.vector < 0:
            return False
        basis = _plane(self.vector)
        small = basis.T @ self.covariance @ basis
        apart = basis.T @ (v - (v @ self.vector) * self.vector)
        return bool(apart @ np.linalg.solve(small, apart) <= CHI2_90)


def bisector(sun: Floats, obs: Floats) -> Floats:
    """Phase-angle bisector b = (o + s)/|o + s|, (T, 3), Hall et al. 2007, eq. (16)."""
    both = sun + obs
    return both / np.linalg.norm(both, axis=-1, keepdims=True)


def _plane(vector: Floats) -> Floats:
    return np.stack(across(vector), axis=1)


def facet(seen: Sequence[Sighting], members: Sequence[int]) -> Direction:
    """The normal common to glints, n·b = 1, by least squares along and across each track."""
    n = np.sum([seen[i].bisector for i in members], axis=0)
    n /= np.linalg.norm(n)
    covariance, chi2 = np.eye(3), 0.0
    for _ in range(20):
        basis = _plane(n)
        matrix, vector, chi2 = np.zeros((2, 2)), np.zeros(2), 0.0
        for i in members:
            one = seen[i]
            u = one.along
            v = np.cross(one.bisector, u)
            for axis, error in zip((u, v), one.errors(), strict=True):
                row, left = basis.T @ axis / error, axis @ (one.bisector - n) / error
                matrix += np.outer(row, row)
                vector += row * left
                chi2 += left**2
        step = np.linalg.solve(matrix, vector)
        covariance = basis @ np.linalg.inv(matrix) @ basis.T
        n = n + basis @ step
        n /= np.linalg.norm(n)
        if np.linalg.norm(step) < 1e-10:
            break
    return Direction(n, covariance, float(chi2), 2 * len(members) - 2, tuple(members))


def cylinder(seen: Sequence[Sighting], members: Sequence[int]) -> Direction | None:
    """The axis perpendicular to all bisectors, c·b = 0; None if they do not determine it.

    The condition c·b = 0 is met at the peak, so its error follows from that of the time: (c·ḃ) σ_t,
    plus half the Sun's angular radius in quadrature.
    """
    b = np.array([seen[i].bisector for i in members])
    rate = np.array([seen[i].rate for i in members])
    sigma = np.array([seen[i].t_error for i in members])
    error = np.full(len(b), 0.01)
    c, matrix = np.eye(3)[2], np.eye(3)
    for _ in range(50):
        matrix = (b / error[:, None] ** 2).T @ b
        values, vectors = np.linalg.eigh(matrix)
        new = vectors[:, 0]
        if np.sqrt(1.0 / max(values[1], 1e-300)) > np.radians(20.0):
            return None
        fresh = np.hypot((rate @ new) * sigma, 0.5 * SUN_ANGULAR_RADIUS)
        done = np.allclose(fresh, error, rtol=1e-6) and abs(new @ c) > 1 - 1e-14
        c, error = new, fresh
        if done:
            break
    basis = _plane(c)
    small = np.linalg.inv(basis.T @ matrix @ basis)
    chi2 = float(np.sum((b @ c / error) ** 2))
    c = c * (1.0 if c[np.argmax(np.abs(c))] > 0 else -1.0)
    return Direction(c, basis @ small @ basis.T, chi2, len(b) - 2, tuple(members))


def facets(seen: Sequence[Sighting], level: float = 0.01) -> list[Direction]:
    """Facets that explain the glints, by agglomerative grouping with one facet per glint.

    Groups are merged, best first, while the p-value of the common direction is at least ``level``.
    """
    groups = [facet(seen, (i,)) for i in range(len(seen))]
    while len(groups) > 1:
        pairs = [
            (facet(seen, a.members + b.members), i, j)
            for i, a in enumerate(groups)
            for j, b in enumerate(groups[:i])
            if a.vector @ b.vector > 0.5
        ]
        if not pairs:
            break
        best, i, j = max(pairs, key=lambda one: one[0].p_value)
        if best.p_value < level:
            break
        groups = [g for k, g in enumerate(groups) if k not in (i, j)] + [best]
    return sorted(groups, key=lambda g: (-len(g.members), g.members))


@dataclass(frozen=True)
class Tracking:
    """A panel that follows the Sun about an axis, with a constant offset.

    Attributes
    ----------
    offsets, errors : (G,) rad
        Azimuth of the panel minus that of the Sun about the axis at each glint.
    tilt : (G,) rad
        Angle of the bisector from the plane normal to the axis, which varies with the season.
    sun : (G,) rad
        The same angle for the Sun: its declination if the axis is the celestial pole.
    mean, error : rad
    chi2, freedom :
    """

    offsets: Floats
    errors: Floats
    tilt: Floats
    sun: Floats
    mean: float
    error: float
    chi2: float
    freedom: int

    @property
    def p_value(self) -> float:
        """Probability of a larger χ² for one offset; 1 without degrees of freedom."""
        return float(stats.chi2.sf(self.chi2, self.freedom)) if self.freedom > 0 else 1.0


def tracking(seen: Sequence[Sighting], sun: Floats, sun_rate: Floats, axis: Floats) -> Tracking:
    """Offset of a panel that rotates about an axis to follow the Sun.

    The azimuth of the panel normal is that of the Sun plus the offset. n·b is largest, and the
    panel glints, when the bisector has the same azimuth. Hence offset = azimuth(b) − azimuth(s) at
    the glint. The angle of the bisector from the plane normal to the axis (``tilt``) varies with
    the season, and so does the strength of the glint.

    Parameters
    ----------
    sun, sun_rate : (G, 3)
        Direction of the Sun at the glints and its rate, rad/s, in the axes of the bisectors.
    axis : (3,)
        Unit vector of the panel's rotation axis; for a geostationary orbit, the orbit normal.
    """
    basis = _plane(axis)

    def azimuth(v: Floats) -> Floats:
        return np.arctan2(v @ basis[:, 1], v @ basis[:, 0])

    b = np.array([s.bisector for s in seen])
    rate = np.array([s.rate for s in seen])
    sigma = np.array([s.t_error for s in seen])

    def turning(v: Floats, change: Floats) -> Floats:
        flat = v - np.outer(v @ axis, axis)
        return np.sum(np.cross(axis, v) * change, axis=1) / np.sum(flat**2, axis=1)

    offsets = np.angle(np.exp(1j * (azimuth(b) - azimuth(sun))))
    speed = turning(b, rate) - turning(sun, sun_rate)
    errors = np.hypot(speed * sigma, 0.25 * SUN_ANGULAR_RADIUS)
    weight = errors**-2
    mean = float(np.average(offsets, weights=weight))
    return Tracking(
        offsets,
        errors,
        np.arcsin(b @ axis),
        np.arcsin(sun @ axis),
        mean,
        float(weight.sum() ** -0.5),
        float(np.sum(((offsets - mean) / errors) ** 2)),
        len(b) - 1,
    )
