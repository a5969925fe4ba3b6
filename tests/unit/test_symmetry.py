"""Where Sun and observer stay in one plane, a body and its mirror image look the same."""

from __future__ import annotations

import numpy as np
import small
from jax.flatten_util import ravel_pytree

from lcbayes._jax import jax, jnp


def in_plane(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Directions in the plane z = 0, as Linares & Crassidis (31) have them."""
    t = np.linspace(0.0, 60.0, n)
    a, b = 0.004 * t + 0.3, 0.02 * t - 0.5
    return tuple(np.stack([np.cos(x), np.sin(x), np.zeros(n)], axis=1) for x in (a, b))  # type: ignore[return-value]


def test_mirror_image_has_the_same_posterior():
    """n → n with −z, ω → (−ω_x, −ω_y, ω_z): the density is the same to rounding, anywhere."""
    sun, obs = in_plane(25)
    light = small.curve(25, 2, spinning=True, sun=sun, obs=obs)
    problem, data = small.posed(light, n_facets=2)
    keys = jax.random.split(jax.random.key(0), 50)
    z = jax.jit(jax.vmap(problem.prior_draw, (0, None)))(keys, data)

    def mirrored(row):
        free = problem.unravel(row)
        free["normals_base"] *= jnp.array([1.0, 1.0, -1.0])
        free["omega_unit"] *= jnp.array([-1.0, -1.0, 1.0])
        return ravel_pytree(free)[0]

    potential = jax.jit(jax.vmap(problem.potential, (0, None)))
    there, here = potential(jax.vmap(mirrored)(z), data), potential(z, data)
    np.testing.assert_allclose(there, here, rtol=1e-10)
    # Mirroring the normals alone is no symmetry of a body that turns.
    swap = jax.vmap(
        lambda row: ravel_pytree(
            problem.unravel(row)
            | {"normals_base": problem.unravel(row)["normals_base"] * jnp.array([1, 1, -1])}
        )[0]
    )
    half = swap(z)
    assert not np.allclose(potential(half, data), here, rtol=1e-6)
