"""Brightness of a body as a series of spherical harmonics, and the evidence of a spin.

N small facets of random normals and areas are, to second order, a random field on the sphere of
normals: a mean and white noise (shot noise). The brightness is linear in the field, so that the
field is marginalised in closed form: the evidence of a spin needs no search over bodies.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.physics.bodies import facets
from lcbayes.physics.brightness import LAMBERT_C, DiffuseLaw, diffuse_kernel

Floats = NDArray[np.float64]

DEGREE = 4
NODES = 200  # of the quadrature over normals
SHOT_NOISE = 0.7  # Σα²/(Σα)² of a few facets with log-normal areas
MEAN_PRECISION = 0.01  # of the mean of the field, relative to its variation


class Response(NamedTuple):
    """Brightness of each harmonic in a frame whose z axis is the pole.

    cosine : (..., T, NC)
        Of Y_lm with m ≥ 0, ordered by m.
    sine : (..., T, NS)
        Of Y_l,−m with m > 0, in the same order.
    """

    cosine: jax.Array
    sine: jax.Array


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Series:
    """Quadrature of the brightness of harmonics over normals.

    Attributes
    ----------
    nodes : (Q, 3)
        Unit normals.
    cosine, sine : (Q, NC), (Q, NS)
        Harmonics times 4π/Q, the weight of a node.
    order : (NC,) int
        m of each cosine term.
    law : str
        One of `brightness.DIFFUSE_LAWS`.
    """

    nodes: jax.Array
    cosine: jax.Array
    sine: jax.Array
    order: jax.Array
    law: DiffuseLaw = field(metadata={"static": True})

    @classmethod
    def of(cls, law: DiffuseLaw, degree: int = DEGREE) -> Series:
        """The harmonics up to a degree for a reflectance."""
        nodes, cosine, sine, order = _tables(degree)
        return cls(
            jnp.asarray(nodes), jnp.asarray(cosine), jnp.asarray(sine), jnp.asarray(order), law
        )

    @property
    def size(self) -> int:
        """Number of harmonics."""
        return self.cosine.shape[1] + self.sine.shape[1]

    def response(self, pole: jax.Array, sun: jax.Array, obs: jax.Array) -> Response:
        """∫ K(s·n, o·n) Y_lm(n) dn for directions (..., T, 3) and normals about a pole (3,)."""
        axes = frame(pole)
        sun, obs = sun @ axes, obs @ axes
        kernel = diffuse_kernel(self.law, sun @ self.nodes.T, obs @ self.nodes.T, LAMBERT_C)[0]
        return Response(kernel @ self.cosine, kernel @ self.sine)

    def turned(self, rows: Response, angle: jax.Array) -> jax.Array:
        """Brightness (..., T, P) of the harmonics of a body turned about z by angles (..., T)."""
        return _rotated(rows.cosine, rows.sine, *self._waves(angle))

    def turned_normal(self, matrix: jax.Array, vector: jax.Array, angle: jax.Array):
        """Normal matrix (P, P) and vector (P,) for a body turned about z by a further angle."""
        waves = self._waves(angle)

        def apply(x: jax.Array) -> jax.Array:
            n = self.cosine.shape[1]
            return _rotated(x[..., :n], x[..., n:], *waves)

        return apply(apply(matrix).T), apply(vector)

    def _waves(self, angle: jax.Array) -> tuple[jax.Array, jax.Array]:
        """cos mθ and sin mθ of each cosine term, (..., NC), for angles θ (...)."""
        zonal = self.cosine.shape[1] - self.sine.shape[1]
        each = angle[..., None] * jnp.arange(float(zonal))
        # The barrier keeps the compiler from computing them again wherever they are used.
        cosine, sine = jax.lax.optimization_barrier((jnp.cos(each), jnp.sin(each)))
        return cosine[..., self.order], sine[..., self.order]


def frame(pole: jax.Array) -> jax.Array:
    """Axes (3, 3) in columns, right-handed, the third of which is the pole."""
    aside = jnp.where(jnp.abs(pole[2]) < 0.9, jnp.array([0.0, 0, 1]), jnp.array([1.0, 0, 0]))
    first = jnp.cross(aside, pole)
    first = first / jnp.linalg.norm(first)
    return jnp.stack([first, jnp.cross(pole, first), pole], axis=1)


def log_evidence(matrix: jax.Array, vector: jax.Array) -> jax.Array:
    """½ hᵀ Λ⁻¹ h − ½ ln det Λ of a Gaussian field with information Λ (P, P) and h (P,)."""
    factor = jnp.linalg.cholesky(matrix)
    white = jax.scipy.linalg.solve_triangular(factor, vector, lower=True)
    return 0.5 * white @ white - jnp.sum(jnp.log(jnp.diagonal(factor)))


def total_area(series: Series, sun: Floats, obs: Floats, flux: Floats) -> float:
    """Albedo-area (m²) of an isotropic body of the same mean brightness."""
    kernel = diffuse_kernel(series.law, sun @ series.nodes.T, obs @ series.nodes.T, LAMBERT_C)[0]
    isotropic = float(jnp.mean(kernel @ series.cosine[:, 0])) / np.sqrt(4 * np.pi)
    return float(abs(np.mean(flux))) / max(isotropic, 1e-300)


def precision(series: Series, total: float) -> Floats:
    """Prior precisions (P,) of the harmonics of a body of a total albedo-area (m²).

    A field of shot noise has the variance `SHOT_NOISE` A²/4π in every harmonic.
    """
    precision_of_terms = np.full(series.size, 4 * np.pi / (SHOT_NOISE * total**2))
    precision_of_terms[0] *= MEAN_PRECISION
    return precision_of_terms


def _rotated(cosine, sine, cos, sin) -> jax.Array:
    zonal = cosine.shape[-1] - sine.shape[-1]
    c, cos, sin = cosine[..., zonal:], cos[..., zonal:], sin[..., zonal:]
    return jnp.concatenate([cosine[..., :zonal], c * cos + sine * sin, sine * cos - c * sin], -1)


@cache
def _tables(degree: int) -> tuple[Floats, Floats, Floats, NDArray[np.int64]]:
    """Nodes (Q, 3), weighted harmonics (Q, NC) and (Q, NS), and m (NC,)."""
    nodes = facets.grid(NODES)
    harmonics = 4 * np.pi / NODES * facets.spherical_harmonics(nodes, degree)
    pairs = [(n, m) for m in range(degree + 1) for n in range(m, degree + 1)]
    cosine = [n * n + n + m for n, m in pairs]
    sine = [n * n + n - m for n, m in pairs if m]
    order = np.array([m for _, m in pairs])
    return nodes, harmonics[:, cosine], harmonics[:, sine], order
