"""Brightness of a body as a series of spherical harmonics for any rotation, and its derivative."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import logm
from scipy.spatial.transform import Rotation

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.inference.spin_search.series import Series, rotated
from lcbayes.physics.bodies import facets
from lcbayes.physics.brightness import LAMBERT_C, diffuse_kernel

Floats = NDArray[np.float64]

SAMPLES = 400  # directions from which the matrices of rotations are determined
MIN_SINE = 1e-12  # of the nutation angle, below which the line of nodes is that of the x axis


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Rotated:
    """The harmonics of a `Series` under rotations.

    Attributes
    ----------
    series : Series
    upright, back : (P, P)
        Rows of brightness times these are those of a body turned by +90° and −90° about y, which
        takes z to x: a rotation about x is one about z between them.
    generators : (3, P, P)
        Change of rows (…, P) per radian of a rotation of the body about its x, y and z axes.
    """

    series: Series
    upright: jax.Array
    back: jax.Array
    generators: jax.Array
    order: tuple[int, ...] = field(metadata={"static": True})

    @property
    def degree(self) -> int:
        """The highest degree of the harmonics."""
        return max(self.order)

    @classmethod
    def of(cls, series: Series) -> Rotated:
        """The rotations of a series."""
        degree = round(series.size**0.5) - 1
        matrices = (jnp.asarray(x) for x in _matrices(degree))
        return cls(series, *matrices, tuple(int(m) for m in np.asarray(series.order)))

    def rows(self, sun: jax.Array, obs: jax.Array) -> jax.Array:
        """Brightness (T, P) of each harmonic at the attitude I, for directions (T, 3)."""
        s = self.series
        kernel = diffuse_kernel(s.law, sun @ s.nodes.T, obs @ s.nodes.T, LAMBERT_C)[0]
        return jnp.concatenate([kernel @ s.cosine, kernel @ s.sine], axis=-1)

    def about_z(self, rows: jax.Array, cosine: jax.Array, sine: jax.Array) -> jax.Array:
        """Rows (..., T, P) of a body turned about z by angles of given cosine and sine (..., T)."""
        multiples = [(jnp.ones_like(cosine), jnp.zeros_like(cosine))]
        for _ in range(self.degree):
            c, s = multiples[-1]
            multiples.append((c * cosine - s * sine, s * cosine + c * sine))
        c, s = (jnp.stack([multiples[m][k] for m in self.order], axis=-1) for k in range(2))
        n = self.series.cosine.shape[1]
        return rotated(rows[..., :n], rows[..., n:], c, s)

    def turned(self, rows: jax.Array, attitude: jax.Array) -> jax.Array:
        """Rows (T, P) of a body of attitudes (T, 3, 3), body to inertial.

        The attitude is a precession about z, a nutation about x and a rotation about z.
        """
        a = attitude
        sine = jnp.sqrt(a[:, 2, 0] ** 2 + a[:, 2, 1] ** 2)
        upright = sine < MIN_SINE
        safe = jnp.where(upright, 1.0, sine)
        precession = (
            jnp.where(upright, a[:, 0, 0], -a[:, 1, 2] / safe),
            jnp.where(upright, a[:, 1, 0], a[:, 0, 2] / safe),
        )
        rotation = (
            jnp.where(upright, 1.0, a[:, 2, 1] / safe),
            jnp.where(upright, 0.0, a[:, 2, 0] / safe),
        )
        tilted = self.about_z(self.about_z(rows, *precession) @ self.upright, a[:, 2, 2], sine)
        return self.about_z(tilted @ self.back, *rotation)

    def slopes(self, rows: jax.Array, field: jax.Array) -> jax.Array:
        """Change (T, 3) of the brightness of a field (P,) per radian about the body's axes."""
        return jnp.einsum("tp,kpq,q->tk", rows, self.generators, field)


@cache
def _matrices(degree: int) -> tuple[Floats, Floats, Floats]:
    """`Rotated.upright`, `back` and `generators` of the harmonics up to a degree."""
    nodes = facets.grid(SAMPLES)
    pairs = [(n, m) for m in range(degree + 1) for n in range(m, degree + 1)]
    order = [n * n + n + m for n, m in pairs] + [n * n + n - m for n, m in pairs if m]

    def harmonics(directions: Floats) -> Floats:
        return facets.spherical_harmonics(directions, degree)[:, order]

    def turned(rotation: Floats) -> Floats:
        # the field at n of a body of attitude A is Y(Aᵀ n)
        at = np.linalg.lstsq(harmonics(nodes), harmonics(nodes @ rotation), rcond=None)[0]
        return np.where(np.abs(at) < 1e-13, 0.0, at)

    upright = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    small = 0.5 / max(degree, 1)  # rad, so that the logarithm is unique
    steps = [logm(turned(Rotation.from_rotvec(small * e).as_matrix())) / small for e in np.eye(3)]
    return turned(upright), turned(upright.T), np.real(np.stack(steps))
