"""The fast flux against a plain sum, its derivatives in every mode, and the printed appendix."""

import math
from typing import Any

import numpy as np
import pytest

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.physics import brightness
from lcbayes.physics.attitude.rotations import constant_rate, to_body
from lcbayes.physics.bodies.facets import normal
from lcbayes.physics.brightness import DIFFUSE_LAWS, flux


def unit(rng, n):
    v = rng.normal(size=(n, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def problem(epochs, facets, seed=1) -> Any:
    rng = np.random.default_rng(seed)
    arrays = unit(rng, epochs), unit(rng, epochs), unit(rng, facets), rng.uniform(0.5, 2.0, facets)
    return tuple(jnp.asarray(x) for x in arrays)


def plain_sum(sun, obs, normals, alpha, law, c):
    """One facet and one epoch after the other, as the papers write it."""
    total = np.zeros(len(sun))
    for t in range(len(sun)):
        for i in range(len(normals)):
            mu0, mu = max(0.0, sun[t] @ normals[i]), max(0.0, obs[t] @ normals[i])
            if mu0 == 0.0 or mu == 0.0:
                continue
            if law == "lambertian":
                k = mu0 * mu / math.pi
            elif law == "non-lambertian":
                k = (1 - (1 - mu0 / 2) ** 5) * (1 - (1 - mu / 2) ** 5) * mu0 * mu / math.pi
            else:
                k = mu0 * mu / (mu0 + mu) + c * mu0 * mu
            total[t] += alpha[i] * k
    return total


def plain_jax(sun, obs, normals, alpha, law, c):
    """The same as array code that JAX differentiates by itself."""
    mu0, mu = jnp.maximum(sun @ normals.T, 0.0), jnp.maximum(obs @ normals.T, 0.0)
    if law == "lambertian":
        k = mu0 * mu / jnp.pi
    elif law == "non-lambertian":
        k = (1 - (1 - mu0 / 2) ** 5) * (1 - (1 - mu / 2) ** 5) * mu0 * mu / jnp.pi
    else:
        k = mu0 * mu / jnp.maximum(mu0 + mu, 1e-12) + c * mu0 * mu
    return k @ alpha


@pytest.mark.parametrize("law", DIFFUSE_LAWS)
@pytest.mark.parametrize("facets", [1, 7, 70])
def test_flux_is_the_sum_over_lit_and_seen_facets(law, facets):
    args = problem(30, facets)
    expected = plain_sum(*(np.asarray(a) for a in args), law=law, c=0.3)
    assert expected.max() > 0.0
    np.testing.assert_allclose(flux(*args, law=law, c=0.3), expected, rtol=1e-13, atol=1e-15)


def test_one_facet_by_hand():
    """Sun and observer at 60° from the normal: f = α (781/1024)²/(4π), as 1 − (3/4)⁵ = 781/1024."""
    s = math.sqrt(3.0) / 2.0
    sun, obs = jnp.array([[s, 0.0, 0.5]]), jnp.array([[0.0, s, 0.5]])
    up, area = jnp.array([[0.0, 0.0, 1.0]]), jnp.array([2.0])
    assert flux(sun, obs, up, area)[0] == pytest.approx(2 * (781 / 1024) ** 2 / (4 * math.pi))
    assert flux(sun, obs, up, area, "lommel-seeliger-lambert", 0.1)[0] == pytest.approx(
        2 * (0.25 + 0.025)
    )


def test_a_facet_turned_away_from_both_is_dark():
    """Without clipping, the product of (4) of two negative cosines would be positive."""
    down = jnp.array([[0.0, 0.0, -1.0]])
    for law in DIFFUSE_LAWS:
        assert flux(-down, -down, down, jnp.ones(1), law)[0] == 0.0
        assert flux(-down, down, down, jnp.ones(1), law)[0] == 0.0
    printed = (1 - (1 + 0.5) ** 5) ** 2 * (-1.0) * (-1.0)
    assert printed > 1.0


def test_printed_visibility_prior_takes_a_back_lit_facet_for_seen():
    """(8) without clipping sums products that are positive when both cosines are negative."""
    sun = obs = np.array([[0.0, 0.0, 1.0]])
    n = np.array([0.0, 0.0, -1.0])
    assert np.sum((sun @ n) * (obs @ n)) > 0.0
    assert np.sum(np.maximum(sun @ n, 0.0) * np.maximum(obs @ n, 0.0)) == 0.0


@pytest.mark.parametrize("facets", [5, 70])
def test_slopes_in_single_precision_leave_the_flux_as_it_is(facets):
    args = problem(12, facets)
    law = "lommel-seeliger-lambert"

    def total(single: bool):
        return jax.jit(
            jax.value_and_grad(
                lambda *a: jnp.sum(flux(*a, law=law, single_slopes=single) ** 2), (0, 1, 2, 3)
            )
        )(*args)

    (value, slopes), (expected, exact) = total(True), total(False)
    assert value == expected
    for result, want in zip(slopes, exact, strict=True):
        size = np.abs(want).max()
        np.testing.assert_allclose(result, want, atol=1e-5 * size)
        assert np.abs(result - want).max() > 1e-12 * size


@pytest.mark.parametrize("law", DIFFUSE_LAWS)
@pytest.mark.parametrize("facets", [5, 70])
def test_every_kind_of_derivative_agrees_with_automatic_differentiation(law, facets):
    args: Any = (*problem(12, facets), jnp.float64(0.3))

    def ours(*args: Any):
        return flux(*args[:4], law=law, c=args[4])

    def theirs(*args: Any):
        return plain_jax(*args[:4], law=law, c=args[4])

    which = (0, 1, 2, 3, 4)
    for mode in (jax.jacfwd, jax.jacrev):
        for result, expected in zip(
            *(jax.jit(mode(f, which))(*args) for f in (ours, theirs)), strict=True
        ):
            np.testing.assert_allclose(result, expected, rtol=1e-12, atol=1e-14)
    # a batch of chains, and second derivatives

    def misfit(f):
        return lambda normals, alpha: jnp.sum((f(*args[:2], normals, alpha, args[4]) - 0.4) ** 2)

    shifted = jnp.stack([args[3], 2.0 * args[3], args[3] ** 2])
    for result, expected in zip(
        *(
            jax.jit(jax.vmap(jax.grad(misfit(f), (0, 1)), in_axes=(None, 0)))(args[2], shifted)
            for f in (ours, theirs)
        ),
        strict=True,
    ):
        np.testing.assert_allclose(result, expected, rtol=1e-11, atol=1e-13)
    if facets == 5:
        for result, expected in zip(
            *(
                jax.tree.leaves(jax.jit(jax.hessian(misfit(f), (0, 1)))(args[2], args[3]))
                for f in (ours, theirs)
            ),
            strict=True,
        ):
            np.testing.assert_allclose(result, expected, rtol=1e-10, atol=1e-12)


def test_long_curves_in_blocks_give_the_same(monkeypatch):
    args = problem(103, 6)
    whole = flux(*args)

    def misfit(*args: Any):
        return jnp.sum(flux(*args) ** 2)

    slopes = jax.jit(jax.grad(misfit, (0, 1, 2, 3)))(*args)
    for block in (60, 6 * 103, 10_000):  # a remainder, none, and one short block only
        monkeypatch.setattr(brightness, "_BLOCK_FEW", block)
        np.testing.assert_allclose(flux(*args), whole, rtol=1e-14)
        here = jax.jit(jax.grad(misfit, (0, 1, 2, 3)))(*args)
        for result, expected in zip(here, slopes, strict=True):
            np.testing.assert_allclose(result, expected, rtol=1e-12, atol=1e-14)
        forward = jax.jit(jax.jacfwd(lambda alpha: flux(*args[:3], albedo_area=alpha)))(args[3])
        np.testing.assert_allclose(forward @ args[3], whole, rtol=1e-13)


@pytest.mark.parametrize("law", DIFFUSE_LAWS)
def test_derivatives_are_finite_and_one_sided_at_the_edge(law):
    """At grazing incidence, at a cosine of exactly zero, and in the dark."""
    x, y, z = np.eye(3)
    sun = jnp.asarray([x, z, x, -z, (x + z) / math.sqrt(2), x])
    obs = jnp.asarray([z, x, x, -z, y, -x])
    normals = jnp.asarray([z, -z, x, y])

    def total(*args: Any):
        return jnp.sum(flux(*args, law=law))

    slopes = jax.jit(jax.grad(total, (0, 1, 2, 3)))(sun, obs, normals, jnp.ones(4))
    assert all(np.all(np.isfinite(g)) for g in slopes)
    dark = jax.jit(jax.grad(total, 2))(sun[:1], obs[:1], normals[:1], jnp.ones(1))  # s·n = 0
    np.testing.assert_array_equal(dark, np.zeros((1, 3)))


@pytest.mark.parametrize("law", DIFFUSE_LAWS)
def test_a_direction_that_is_no_number_shows(law):
    sun, obs, normals, alpha = problem(3, 4)
    f = flux(sun.at[1, 0].set(jnp.nan), obs, normals, alpha, law)
    np.testing.assert_array_equal(np.isnan(f), [False, True, False])


def test_unknown_law_lists_the_known_ones():
    with pytest.raises(ValueError, match="unknown diffuse law 'phong'; available: non-lambertian"):
        flux(*problem(2, 2), law="phong")


# Appendix A of Linares & Crassidis, corrected and as printed.


def appendix(alpha, phi, g, q, z, sun, obs, rotation):
    """(A.1) for one epoch: right-hand sides as corrected, and what each misprint makes of them."""
    big_c = (1 - (1 - q / 2) ** 5) * (1 - (1 - z / 2) ** 5)
    wq, wz = 1 - (1 - q / 2) ** 5, 1 - (1 - z / 2) ** 5
    c1 = alpha / math.pi * (2.5 * z * q * (1 - z / 2) ** 4 * wq + big_c * q)
    c2 = alpha / math.pi * (2.5 * z * q * wz * (1 - q / 2) ** 4 + big_c * z)
    c1_printed = alpha / math.pi * (2.5 * z * q * (1 - (1 - z / 2) ** 4) * wq + big_c * q)
    c2_printed = alpha / math.pi * (2.5 * z * q * wz * (1 - (1 - q / 2) ** 4) + big_c * z)
    s = math.sqrt(1 - g**2)
    d_phi = np.array([-math.sin(phi) * s, math.cos(phi) * s, 0.0])
    d_phi_printed = np.array([-g * math.sin(phi) * s, math.cos(phi) * s, 0.0])
    d_g = np.array([-g * math.cos(phi) / s, -g * math.sin(phi) / s, 1.0])

    def slope(c1, c2, d, rotation=rotation):
        return c1 * obs @ (rotation @ d) + c2 * sun @ (rotation @ d)

    right = (z * q / math.pi * big_c, slope(c1, c2, d_phi), slope(c1, c2, d_g))
    wrong = {
        "A.1d": slope(c1_printed, c2, d_phi),
        "A.1e": slope(c1, c2_printed, d_phi),
        "A.1f": slope(c1, c2, d_phi_printed),
        "A.1b": slope(c1, c2, d_phi, np.eye(3)),  # body-frame derivative, not rotated
    }
    wrong_g = {"A.1c": slope(c1, c2, d_g, np.eye(3))}
    return right, wrong, wrong_g


def test_corrected_appendix_agrees_with_autodiff_and_the_printed_one_does_not():
    alpha, phi, g, omega = 1.7, 0.6, 0.5, jnp.array([0.2, -0.1, 0.4])
    rng = np.random.default_rng(3)
    n = np.asarray(normal(jnp.float64(phi), jnp.float64(g)))
    t = jnp.array([1.3])
    rotation = np.asarray(constant_rate(t, omega))[0]
    sun = rotation @ n + 0.6 * unit(rng, 1)[0]
    obs = rotation @ n + 0.6 * unit(rng, 1)[0]
    sun, obs = sun / np.linalg.norm(sun), obs / np.linalg.norm(obs)

    def model(alpha, phi, g):
        a = constant_rate(t, omega)
        bodies = (to_body(a, jnp.asarray(v)[None]) for v in (sun, obs))
        return flux(*bodies, normals=normal(phi, g)[None], albedo_area=jnp.asarray(alpha)[None])[0]

    exact = jax.jit(jax.grad(model, (0, 1, 2)))(*(jnp.float64(v) for v in (alpha, phi, g)))
    q, z = float(sun @ rotation @ n), float(obs @ rotation @ n)
    assert min(q, z) > 0.3
    right, wrong, wrong_g = appendix(alpha, phi, g, q, z, sun, obs, rotation)
    np.testing.assert_allclose(right, exact, rtol=1e-12)
    for where, value in wrong.items():
        assert value != pytest.approx(float(exact[1]), rel=1e-3), where
    for where, value in wrong_g.items():
        assert value != pytest.approx(float(exact[2]), rel=1e-3), where


def test_facets_along_the_normal_of_an_in_plane_geometry_are_never_lit():
    """(31), (32): facets at g = ±1 send nothing while Sun and observer stay in the plane z = 0."""
    angle = jnp.linspace(0.0, 2.0 * jnp.pi, 40)
    sun = jnp.tile(jnp.array([1.0, 0.0, 0.0]), (40, 1))
    obs = jnp.stack([jnp.cos(angle), jnp.sin(angle), jnp.zeros(40)], axis=1)
    phi, g = jnp.array([0.0, 0.0]), jnp.array([1.0, -1.0])
    for law in DIFFUSE_LAWS:
        np.testing.assert_array_equal(flux(sun, obs, normal(phi, g), 10.0 * jnp.ones(2), law), 0.0)
    side = normal(jnp.array([0.3]), jnp.array([0.0]))
    assert flux(sun, obs, side, jnp.ones(1)).max() > 0.1
