"""Symmetries: transformations between bodies with identical light curves."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from jax.flatten_util import ravel_pytree
from numpy.typing import NDArray

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.priors import TRACELESS
from lcbayes.modelling.problem import Problem

type Sites = Mapping[str, NDArray[np.float64]] | None

FLAT = 1e-6  # rms distance of unit vectors from a plane that is negligible, rad

# Sites that hold vectors, and their sign under reflection: ω is an axial vector and reverses.
VECTORS = {"normals_base": 1.0, "omega_unit": -1.0}
TENSOR = "inertia_base"  # in the basis `priors.TRACELESS` of symmetric tensors: S → R S R


def plane_normal(data: Epochs) -> NDArray[np.float64] | None:
    """The normal (3,) of the plane of all directions to Sun and observer, if they are in one."""
    directions = np.concatenate([np.asarray(data.sun), np.asarray(data.obs)])
    _, singular, axes = np.linalg.svd(directions, full_matrices=False)
    return axes[2] if singular[2] <= FLAT * np.sqrt(len(directions)) else None


def mirror_of(
    problem: Problem,
    data: Epochs,
    mirrored: Callable[..., Sites] | None,
    options: Mapping[str, Any],
) -> NDArray[np.float64] | None:
    """The matrix (D, D) of a model's own reflection in that plane, or of `plane_mirror`.

    Parameters
    ----------
    mirrored : callable, optional
        The model's hook: normal of the plane and options → {site: (n, n)}, None if its body has no
        reflection.
    """
    if mirrored is None:
        return plane_mirror(problem, data)
    normal = plane_normal(data)
    sites = None if normal is None else mirrored(normal, **options)
    return None if sites is None else on_sites(problem, sites)


def on_sites(problem: Problem, sites: Mapping[str, NDArray[np.float64]]) -> NDArray[np.float64]:
    """The matrix (D, D) that acts on some unconstrained sites and leaves the others unchanged."""
    full = np.eye(problem.dim)
    for name, matrix in sites.items():
        rows = problem.rows([name])
        full[np.ix_(rows, rows)] = matrix
    return full


def plane_mirror(problem: Problem, data: Epochs) -> NDArray[np.float64] | None:
    """The matrix (D, D) of the reflection in the plane of Sun and observer, if there is one.

    Let p be the plane's normal and R = I − 2 p pᵀ. A body with normals R n that rotates with −R ω
    has at all times the same cosines μ₀, μ as the body with n and ω. This follows from
    R A(ω, t) R = A(−R ω, t), with the body axes equal to the inertial axes at t = 0. For
    torque-free rotation the inertia of the image is R J R. The matrix is orthogonal and its own
    inverse, so its Jacobian is one. The result is None if the directions are not coplanar or the
    model has no facet normals.
    """
    if "normals_base" not in problem.names or (normal := plane_normal(data)) is None:
        return None
    mirror = np.eye(3) - 2.0 * np.outer(normal, normal)

    def one(z: jax.Array) -> jax.Array:
        free = dict(problem.unravel(z))
        for name, sign in VECTORS.items():
            if name in free:
                free[name] = sign * free[name] @ mirror
        if TENSOR in free:
            image = mirror @ jnp.tensordot(free[TENSOR], TRACELESS, 1) @ mirror
            free[TENSOR] = jnp.tensordot(TRACELESS, image, 2)
        return ravel_pytree(free)[0]

    return np.asarray(jax.vmap(one)(jnp.eye(problem.dim))).T
