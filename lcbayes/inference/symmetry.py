"""Bodies that look the same: moves from one to the other."""

from __future__ import annotations

import numpy as np
from jax.flatten_util import ravel_pytree
from numpy.typing import NDArray

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.priors import TRACELESS
from lcbayes.modelling.problem import Problem

FLAT = 1e-6  # rms distance of unit vectors from a plane that counts as none, rad

# Sites that carry vectors, and their sign under a mirror: ω, an axial vector, turns about.
VECTORS = {"normals_base": 1.0, "omega_unit": -1.0}
TENSOR = "inertia_base"  # in the basis `priors.TRACELESS` of symmetric tensors: S → R S R


def plane_mirror(problem: Problem, data: Epochs) -> NDArray[np.float64] | None:
    """Where Sun and observer stay in one plane, the matrix (D, D) of the mirror at that plane.

    With p the plane's normal and R = I − 2 p pᵀ, a body of normals R n that turns with −R ω has at
    all times the cosines μ₀, μ of the body of n and ω, as R A(ω, t) R = A(−R ω, t), and at t = 0
    the body's axes are the inertial ones; without torque its inertia is R J R. The matrix is its
    own inverse and orthogonal, so its Jacobian is one. None where the geometry is not flat or the
    model has no facet normals.
    """
    if "normals_base" not in problem.names:
        return None
    directions = np.concatenate([np.asarray(data.sun), np.asarray(data.obs)])
    _, singular, axes = np.linalg.svd(directions, full_matrices=False)
    if singular[2] > FLAT * np.sqrt(len(directions)):
        return None
    mirror = np.eye(3) - 2.0 * np.outer(axes[2], axes[2])

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
