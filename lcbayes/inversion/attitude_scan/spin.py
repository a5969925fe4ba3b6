"""Levenberg-Marquardt over pole, period and a smooth body, for many hypotheses at once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.levenberg_marquardt import NIELSEN, Quadratic, levenberg_marquardt
from lcbayes.inversion.attitude_scan.points import Points
from lcbayes.inversion.attitude_scan.smooth import SmoothBody, Spin, normal_equations
from lcbayes.physics.attitude import rotations

Floats = NDArray[np.float64]

FREE = (1.0, 1.0, 1.0)  # two rotations of the pole, frequency


class Ends(NamedTuple):
    """End points of searches: arrays of B rows, NumPy or JAX."""

    tilt: Any  # (B, 3, 3)
    frequency: Any  # (B,) Hz
    coefficients: Any  # (B, P)
    value: Any  # (B,) the objective
    squares: Any  # (B, K)
    steps: Any  # (B,)

    @property
    def pole(self) -> NDArray:
        """Poles (B, 3), inertial."""
        return self.tilt[:, :, 2]

    def rows(self, which) -> Ends:
        """The selected rows."""
        return Ends(*(x[which] for x in self))

    def forward(self) -> Ends:
        """The same end points with positive frequencies. Bodies with negative frequency are rotated
        by half a turn about their x axis, which only changes signs of harmonics."""
        back = self.frequency < 0
        over = np.where(back[:, None, None], np.diag([1.0, -1.0, -1.0]), np.eye(3))
        degree, m = _orders(self.coefficients.shape[1])
        sign = (-1.0) ** (degree + np.abs(m)) * np.where(m < 0, -1.0, 1.0)
        return self._replace(
            tilt=self.tilt @ over,
            frequency=np.abs(self.frequency),
            coefficients=np.where(back[:, None], sign, 1.0) * self.coefficients,
        )

    @staticmethod
    def joined(parts: Sequence[Ends]) -> Ends:
        """Concatenated rows of all parts."""
        return Ends(*(np.concatenate(x) for x in zip(*parts, strict=True)))


@jax.jit
def solve(
    body: SmoothBody,
    points: Points,
    starts: Spin,
    free: jax.Array,
    most: int,
    tolerance: jax.Array | float,
) -> Ends:
    """The best body, pole and frequency near each start.

    Parameters
    ----------
    body : SmoothBody
    points : Points
    starts : Spin
        B starts, stacked.
    free : (3,)
        One for each free parameter (two rotations of the pole, frequency), zero for a fixed one.
    most : int
        Maximum number of steps.
    tolerance : float
        Gain in the objective (nat) below which three steps in a row end a search.

    Returns
    -------
    Ends

    References
    ----------
    Kaasalainen, Torppa & Muinonen 2001.
    """
    # half a turn over the span: of the order of the frequency uncertainty
    unit = 0.5 / points.span
    hold = jnp.concatenate([free, jnp.ones(starts.coefficients.shape[1])])

    def model(spin: Spin) -> Quadratic:
        value, gradient, curvature, squares = normal_equations(body, points, spin, unit)
        return Quadratic(value, gradient * hold, curvature * hold * hold[:, None], squares)

    def one(spin: Spin) -> Ends:
        end = levenberg_marquardt(
            model,
            spin,
            num_steps=most,
            tolerance=tolerance,
            controls=NIELSEN,
            move=lambda spin, step: spin.moved(step, unit),
        )
        tilt, frequency, coefficients = end.position
        return Ends(tilt, frequency, coefficients, end.model.value, end.model.aux, end.steps)

    # one at a time: a hypothesis occupies a core, and its arrays fill the core's cache
    return jax.lax.map(one, starts)


def spheres(body: SmoothBody, poles: Floats, frequencies: Floats) -> Spin:
    """Spherical starts with these poles (B, 3) and frequencies (B,)."""
    none = np.zeros((len(poles), body.harmonics.shape[1]))
    return Spin(*map(jnp.asarray, (tilts(poles), frequencies, none)))


def finer(body: SmoothBody, ends: Ends) -> Spin:
    """Starts at the end points of a search with harmonics of lower degree."""
    missing = body.harmonics.shape[1] - ends.coefficients.shape[1]
    shape = np.pad(ends.coefficients, ((0, 0), (0, missing)))
    return Spin(*map(jnp.asarray, (ends.tilt, ends.frequency, shape)))


_brought = jax.jit(jax.vmap(rotations.brought_to))


def tilts(poles: Floats) -> Floats:
    """Attitudes (B, 3, 3) of bodies with these poles (B, 3), `attitude.brought_to`."""
    return np.asarray(_brought(jnp.asarray(poles)))


def in_convention(tilt: Floats, coefficients: Floats) -> tuple[float, float, Floats]:
    """Longitude and latitude of the pole (rad), and the harmonics of the body in axes of `tilts`.

    The body is rotated about its z axis so that its attitude at the middle of the data is
    `attitude.brought_to` of the pole, as in the model "convex-grid".
    """
    pole = tilt[:, 2]
    lon, lat = float(np.arctan2(pole[1], pole[0])), float(np.arcsin(np.clip(pole[2], -1, 1)))
    turn = tilts(pole[None])[0].T @ tilt
    psi = np.arctan2(turn[1, 0], turn[0, 0])
    degree, m = _orders(len(coefficients))
    other = coefficients[degree * degree + degree - m - 1]  # of the same degree and opposite order
    turned = coefficients * np.cos(m * psi) - other * np.sin(m * psi)
    return lon % (2 * np.pi), lat, turned


def _orders(count: int) -> tuple[NDArray[np.integer], NDArray[np.integer]]:
    """Degree l and order m of each of ``count`` harmonics, without the constant."""
    index = np.arange(1, count + 1)
    degree = np.sqrt(index).astype(int)
    return degree, index - degree * degree - degree
