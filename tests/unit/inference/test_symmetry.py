"""Where Sun and observer stay in one plane, a body and its mirror image look the same."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

import lcbayes
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.inference import search, solutions, symmetry
from lcbayes.inference.label_switching import FacetOrder
from lcbayes.samplers import smc
from tests.helpers import small_curves
from tests.helpers.false_alarms import EACH, limit


def in_plane(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Directions in the plane z = 0, as Linares & Crassidis (31) have them."""
    t = np.linspace(0.0, 60.0, n)
    a, b = 0.004 * t + 0.3, 0.02 * t - 0.5
    return tuple(np.stack([np.cos(x), np.sin(x), np.zeros(n)], axis=1) for x in (a, b))  # type: ignore[return-value]


def test_mirror_image_has_the_same_posterior():
    """n → n with −z, ω → (−ω_x, −ω_y, ω_z): the density is the same to rounding, anywhere."""
    sun, obs = in_plane(25)
    light = small_curves.curve(25, 2, spinning=True, sun=sun, obs=obs)
    problem, data = small_curves.posterior(light, n_facets=2)
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


def test_mirror_is_found_in_any_plane():
    """A tilted plane: the matrix is its own inverse, orthogonal, and leaves the density alone."""
    turn = np.linalg.qr(np.random.default_rng(1).standard_normal((3, 3)))[0]
    sun, obs = (v @ turn.T for v in in_plane(25))
    problem, data = small_curves.posterior(
        small_curves.curve(25, 2, spinning=True, sun=sun, obs=obs), n_facets=2
    )
    mirror = symmetry.plane_mirror(problem, data)
    assert mirror is not None
    np.testing.assert_allclose(mirror @ mirror, np.eye(problem.dim), atol=1e-12)
    np.testing.assert_allclose(mirror.T, mirror, atol=1e-12)
    keys = jax.random.split(jax.random.key(0), 50)
    z = jax.jit(jax.vmap(problem.prior_draw, (0, None)))(keys, data)
    potential = jax.jit(jax.vmap(problem.potential, (0, None)))
    np.testing.assert_allclose(potential(z @ mirror.T, data), potential(z, data), rtol=1e-9)
    assert not np.allclose(z @ mirror.T, z)


@pytest.mark.slow
def test_mirror_of_a_body_without_torque_has_the_mirrored_inertia():
    turn = np.linalg.qr(np.random.default_rng(2).standard_normal((3, 3)))[0]
    sun, obs = (v @ turn.T for v in in_plane(9))
    light = small_curves.curve(9, 2, spinning=True, sun=sun, obs=obs)
    problem, data = small_curves.posterior(light, n_facets=2, spin="torque-free")
    mirror = symmetry.plane_mirror(problem, data)
    assert mirror is not None
    np.testing.assert_allclose(mirror @ mirror, np.eye(problem.dim), atol=1e-12)
    keys = jax.random.split(jax.random.key(0), 20)
    z = jax.jit(jax.vmap(problem.prior_draw, (0, None)))(keys, data)
    potential = jax.jit(jax.vmap(problem.potential, (0, None)))
    np.testing.assert_allclose(potential(z @ mirror.T, data), potential(z, data), rtol=1e-7)


def test_images_of_solutions_are_solutions_where_the_mirror_is_a_symmetry():
    """Once each, and not those of a matrix that is none, nor that of a facet in the plane."""
    sun, obs = in_plane(25)
    light = small_curves.curve(25, 1, noise=1e-3, sun=sun, obs=obs)
    problem, data = small_curves.posterior(light, n_facets=1, spin="none")
    order = FacetOrder(problem, ("normals_base", "log_albedo_area"))
    mirror = symmetry.plane_mirror(problem, data)
    assert mirror is not None
    best = search.polish(problem, data, np.asarray(small_curves.truth(problem, data, 1))[None], 1)
    (result,) = solutions.distinct(problem, data, best, order, 4)

    def images(matrix, *among):
        return solutions.with_images(problem, data, list(among), matrix, order)

    both = images(mirror, result)
    # Rounding decides which of the two comes first.
    assert sorted(s.z.tolist() for s in both) == sorted(
        [result.z.tolist(), (mirror @ result.z).tolist()]
    )
    assert [s.hits for s in both] == [1, 1]
    assert len(images(mirror, *both)) == 2
    assert len(images(-np.eye(problem.dim), result)) == 1
    flat = 0.5 * (result.z + mirror @ result.z)
    potential = float(problem.potential(jnp.asarray(flat), data))
    assert len(images(mirror, replace(result, z=flat, potential=potential))) == 1


@pytest.mark.slow
@pytest.mark.statistical(false_alarm=EACH)
def test_a_mirror_image_that_no_start_reached_is_sampled():
    """From two starts, of which one alone ends at a solution: both halves, to their own errors."""
    sun, obs = in_plane(25)
    light = small_curves.curve(25, 1, noise=1e-3, sun=sun, obs=obs)
    for seed in range(3):
        result = lcbayes.fit(
            light, n_facets=1, spin="none", num_starts=2, num_samples=300, seed=seed
        )
        one, two = result.content["modes"]
        assert one["weight"] + two["weight"] == pytest.approx(1.0)
        assert one["weight_sd"] < 0.08
        assert abs(one["weight"] - 0.5) < limit(3) * one["weight_sd"]
        (g, other) = (m["parameters"]["g[0]"]["mean"] for m in (one, two))
        assert g * other < 0.0


def test_no_mirror_out_of_plane():
    assert (
        symmetry.plane_mirror(*small_curves.posterior(small_curves.curve(25), n_facets=1)) is None
    )


@pytest.mark.statistical(false_alarm=EACH)
def test_mirror_of_what_is_not_symmetric_still_leaves_the_posterior():
    """z → −z on a Gaussian about 1: half are asked, and few go; the mean stays where it is.

    Two comparisons, 4000 particles.
    """
    from lcbayes.samplers import moves
    from lcbayes.samplers.kernels.trajectory import State

    class Shifted:
        def potential(self, z, data):  # noqa: ARG002
            return 0.5 * jnp.sum((z - 1.0) ** 2)

    _, data = small_curves.posterior(small_curves.curve(5), n_facets=1)
    n, problem = 4000, Shifted()
    z = 1.0 + np.random.default_rng(0).standard_normal((n, 1))
    state = State(jnp.asarray(z), jnp.asarray(0.5 * (z[:, 0] - 1) ** 2), jnp.asarray(z - 1))
    keys = jax.random.split(jax.random.key(1), n)
    potential = partial(problem.potential, data=data)
    out = jax.vmap(partial(moves.reflect, potential, -jnp.eye(1)))(keys, state)
    went = np.asarray(out.z != state.z)
    assert 0.05 < went.mean() < 0.45
    # The change over has probability ½ E min(1, exp(−2 z)) = Φ(−1).
    assert abs(went.mean() - 0.1587) < limit(2) * np.sqrt(0.1587 * 0.8413 / n)
    assert abs(np.mean(out.z) - 1.0) < limit(2) / np.sqrt(n)
    np.testing.assert_allclose(out.grad, out.z - 1.0)


@pytest.mark.statistical(false_alarm=EACH)
@pytest.mark.slow
def test_mirror_images_weigh_the_same_with_the_move():
    """A run of 200 particles: the weight of one side is binomial."""
    sun, obs = in_plane(25)
    light = small_curves.curve(25, 1, noise=0.1, sun=sun, obs=obs)
    problem, data = small_curves.posterior(light, n_facets=1, spin="none")
    mirror = symmetry.plane_mirror(problem, data)
    plan = smc.Plan(oversampling=1)
    result = smc.run(problem, data, jax.random.key(0), 200, plan=plan, mirror=mirror)
    up = jax.vmap(lambda z: problem.unravel(z)["normals_base"][0, 2])(result.z) > 0
    assert abs(np.mean(up) - 0.5) < limit() * 0.5 / np.sqrt(200)
