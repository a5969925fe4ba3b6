"""Sparse points and their linear model: logarithms of brightness as harmonics of the bisector.

ln f = o_c + p(α) + Σ c_k B_k(b), with the bisector b of the directions to Sun and observer in the
body frame, one offset for each curve and a phase law of two terms. The shape has polynomials z^n
and z^n u^m of degree up to four, with u = x + iy, and z^n u⁴/|u|²: the last are what u² is at half
the period, so that a brick is described at its own period too. To first order a triaxial ellipsoid
has z² and u². For a given pole the moduli are fixed, and a period only turns u by the angle 2π f t.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lcbayes.core.constants import DAY_S
from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.albedo_area.observed import linear_flux
from lcbayes.modelling.epochs import Epochs

Floats = NDArray[np.float64]

SURGE_RAD = 0.09  # width of the opposition surge of the phase law
# prior mean and standard deviation, in ln flux, of the offsets and the phase law
OFFSET = (0.0, 1.0)
PHASE_SLOPE, SURGE = (-1.6, 0.7), (0.2, 0.2)  # per radian; of exp(−α/0.09)
ZONAL = (1, 2, 3, 4)  # powers of z
SECTORAL = ((2, 0), (1, 0), (1, 1), (2, 1), (2, 2), (3, 0), (4, 0))  # m and n of z^n u^m
HIGHER = ((4, 0), (4, 1), (4, 2), (6, 0), (8, 0))  # m and n of z^n |u|² (u/|u|)^m
# order in longitude, and whether the power of z is odd, of each column of `shape_columns`
_TERMS = (
    [(0, n) for n in ZONAL] + [(0, 0)] * 3 + [x for x in (*SECTORAL, *HIGHER) for _ in range(2)]
)
ORDERS, ODD = np.array([m for m, _ in _TERMS]), np.array([n % 2 == 1 for _, n in _TERMS])
ERROR_FLOOR = 0.015  # of known relative errors
UNKNOWN_NOISE = 0.06  # expected, where errors are unknown
NIGHT_S = 0.5 * DAY_S
ROWS, NIGHTS = 32, 16  # smallest steps of the numbers of points and nights; see `filled_size`


class SparsePoints(NamedTuple):
    """Points of a light curve for the linear model: arrays of NumPy or JAX.

    The numbers of points and nights are rounded up, so that objects share compiled programs.

    Attributes
    ----------
    t : (T,) s
        Since the middle of the data.
    bisector, across : (T, 3)
        Unit vectors along the sum of those to Sun and observer, and the difference of these,
        inertial.
    log_flux : (T,)
        Its median over each curve is zero.
    error : (T,)
        Relative; one where unknown.
    fixed : (T, C + 2)
        Columns of the offsets and of the phase law.
    group : (T, K)
        One where a point belongs to a group with a common noise level.
    night : (T, M)
        One where a point belongs to a night, whose points share an error.
    used : (T,)
        One; zero where a row only fills the arrays.
    noise : float
        Expected noise level in units of ``error``.
    span : s
        Length of the data.
    """

    t: Any
    bisector: Any
    across: Any
    log_flux: Any
    error: Any
    fixed: Any
    group: Any
    night: Any
    used: Any
    noise: Any
    span: Any

    @property
    def night_index(self) -> jax.Array:
        """The night of each point (T,); of a row that only fills the arrays, the first."""
        return jnp.argmax(jnp.asarray(self.night), axis=1)

    def night_sums(self, values: ArrayLike) -> jax.Array:
        """Sums (M, …) of values (T, …) over the points of each night."""
        return jax.ops.segment_sum(jnp.asarray(values), self.night_index, self.night.shape[1])

    @classmethod
    def of(cls, curve: LightCurve) -> SparsePoints:
        """The points of a light curve; every curve has its own offset and noise level.

        Raises
        ------
        InputError
            If a brightness is not positive.
        """
        epochs = Epochs.of(curve)
        flux, error = linear_flux(curve, epochs)
        if not np.all(flux > 0):
            raise InputError(
                f"{np.sum(~(flux > 0))} points have no positive brightness, and the periodogram "
                "takes logarithms; leave them out, or give --first-stage bodies"
            )
        known = epochs.has_error
        member = _members(np.unique(curve.curve, return_inverse=True)[1])
        y = np.log(flux)
        y = y - member @ [np.median(y[m > 0]) for m in member.T]
        middle = np.asarray(epochs.t - epochs.t_middle, float)
        bisector = np.asarray(curve.sun) + np.asarray(curve.obs)
        nights = nights_of(np.asarray(curve.t), curve.curve)
        n_nights = int(nights.max()) + 1
        more = filled_size(len(y), ROWS) - len(y)
        empty = filled_size(n_nights, NIGHTS) - n_nights

        def filled(x: Floats, value: float = 0.0) -> Floats:
            ends = [(0, more)] + [(0, 0)] * (x.ndim - 1)
            return np.pad(x, ends, constant_values=value)

        return cls(
            filled(middle),
            filled(bisector / np.linalg.norm(bisector, axis=1, keepdims=True)),
            filled(np.asarray(curve.sun) - np.asarray(curve.obs)),
            filled(y),
            filled(np.hypot(error / flux, ERROR_FLOOR) if known else np.ones_like(y), 1.0),
            filled(np.column_stack([member, phase_columns(np.asarray(curve.phase_angle))])),
            np.vstack([member, np.repeat(member[:1], more, axis=0)]),
            np.pad(_members(nights), ((0, more), (0, empty))),
            filled(np.ones_like(y)),
            1.0 if known else UNKNOWN_NOISE,
            float(np.ptp(curve.t)),
        )


def filled_size(n: int, step: int) -> int:
    """The least of a few sizes that is at least n: multiples of ``step``, four to each doubling
    beyond eight.

    Examples
    --------
    >>> filled_size(100, 32), filled_size(300, 32), filled_size(1100, 32)
    (128, 320, 1280)
    """
    while n > 8 * step:
        step *= 2
    return -(-n // step) * step


def shape_of(curve: LightCurve) -> tuple[int, int, int]:
    """What determines the compiled programs of a light curve: the filled numbers of points and
    nights, and the number of curves."""
    n_nights = int(nights_of(np.asarray(curve.t), curve.curve).max()) + 1
    return filled_size(curve.n_obs, ROWS), filled_size(n_nights, NIGHTS), curve.n_curves


def nights_of(t: Floats, curve: NDArray[np.integer]) -> NDArray[np.integer]:
    """The night of each point (T,): points of one curve without a gap of half a day."""
    order = np.lexsort((t, curve))
    new = (np.diff(curve[order]) != 0) | (np.diff(t[order]) > NIGHT_S)
    night = np.empty(len(t), int)
    night[order] = np.concatenate([[0], np.cumsum(new)])
    return night


def _members(group: NDArray[np.integer]) -> Floats:
    return (group[:, None] == np.arange(group.max() + 1)).astype(float)


def phase_columns(alpha: Floats) -> Floats:
    """Terms of the phase law (T, 2): α and exp(−α/0.09), less their values at 0.2 rad."""
    return np.column_stack([alpha - 0.2, np.exp(-alpha / SURGE_RAD) - np.exp(-0.2 / SURGE_RAD)])


def fixed_prior(n_curves: int) -> tuple[Floats, Floats]:
    """Prior means and standard deviations (C + 2,) of offsets and phase law."""
    rows = [OFFSET] * n_curves + [PHASE_SLOPE, SURGE]
    return np.array([m for m, _ in rows]), np.array([s for _, s in rows])


def shape_columns(
    bisector: ArrayLike, across: ArrayLike, tilt: ArrayLike, turns: ArrayLike
) -> jax.Array:
    """Harmonics of the bisector in the body frame, and terms of the phase angle, (T, 31).

    Parameters
    ----------
    bisector, across : (T, 3)
        Inertial unit vectors, and the differences of those to Sun and observer.
    tilt : (3, 3)
        Body to inertial at the middle of the data; the third column is the pole.
    turns : (T,)
        Turns of the body since then.
    """
    x, y, z = (jnp.asarray(bisector) @ jnp.asarray(tilt)).T
    turns = jnp.asarray(turns)
    angle = 2.0 * jnp.pi * (turns - jnp.floor(turns))
    u = (x + 1j * y) * jnp.exp(-1j * angle)
    modulus = jnp.maximum(jnp.abs(u), 1e-6)
    turned = {1: u / modulus}
    for m in range(2, 9):
        turned[m] = turned[m - 1] * turned[1]
    out = [z**n - (1.0 / (n + 1) if n % 2 == 0 else 0.0) for n in ZONAL]
    across, tilt = jnp.asarray(across), jnp.asarray(tilt)
    out += [jnp.abs(z) - 0.5, jnp.sum(across**2, axis=1) - 0.04, (across @ tilt[:, 2]) ** 2]
    terms = [(m, n, m) for m, n in SECTORAL] + [(m, n, 2) for m, n in HIGHER]
    for m, n, k in terms:
        one = turned[m] * modulus**k * z**n
        out += [one.real, one.imag]
    return jnp.stack(out, axis=1)
