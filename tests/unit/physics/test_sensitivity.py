"""Closed forms of the papers against automatic differentiation, on 1,000 random cases."""

from __future__ import annotations

import numpy as np
import pytest

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.physics.attitude import rotations
from lcbayes.physics.brightness import flux_brdf
from lcbayes.physics.sensitivity import (
    CLOSED_FORMS,
    MAGNITUDE_PER_NEPER,
    attitude_gradient,
    closed_form,
    magnitude_gradient,
    nullspace,
)

CASES, FACETS = 1000, 3


def units(rng, *shape):
    v = rng.standard_normal((*shape, 3))
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def around(rng, axis, least):
    """Unit vectors with cosine to ``axis`` uniform between ``least`` and 1."""
    along = rng.uniform(least, 1.0, axis.shape[:-1])[..., None]
    across = np.cross(axis, units(rng, *axis.shape[:-1]))
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    return along * axis + np.sqrt(1.0 - along**2) * across


def bodies(seed, facets=FACETS, cases=CASES):
    """Random bodies and directions; half the first facets are close to a glint.

    Every body has one facet lit and seen at least; the others face anywhere.
    """
    rng = np.random.default_rng(seed)
    first = units(rng, cases)
    obs = around(rng, first, 0.05)
    mirrored = 2.0 * np.sum(obs * first, -1)[:, None] * first - obs
    near = around(rng, mirrored, 0.998)
    glint = (np.arange(cases) % 2 == 0) & (np.sum(near * first, -1) > 0.02)
    sun = np.where(glint[:, None], near, around(rng, first, 0.05))
    normals = np.concatenate([first[:, None], units(rng, cases, facets - 1)], axis=1)
    u = np.cross(normals, units(rng, cases, facets))
    u /= np.linalg.norm(u, axis=-1, keepdims=True)
    params = {
        "r_diff": rng.uniform(0.05, 0.95, (cases, facets)),
        "r_spec": rng.uniform(0.05, 0.95, (cases, facets)),
        "nu": 10.0 ** rng.uniform(0.0, 3.0, (cases, facets)),
        "nv": 10.0 ** rng.uniform(0.0, 3.0, (cases, facets)),
    }
    area = rng.uniform(0.5, 5.0, (cases, facets))
    return jax.tree.map(jnp.asarray, (sun, obs, normals, area, params, u))


def by_autodiff(law, sun, obs, normals, area, params, u):
    """Flux, ∂/∂δα with a finite rotation inside, ∂/∂parameters; of one body."""

    def flux(delta, params):
        turn = rotations.constant_rate(jnp.ones(1), delta)[0]
        return flux_brdf((turn @ sun)[None], (turn @ obs)[None], normals, area, law, params, u)[0]

    value = flux(jnp.zeros(3), params)
    return value, *jax.grad(flux, argnums=(0, 1))(jnp.zeros(3), params)


def relative(ours, theirs):
    """Length of the difference over the length of the reference, per case."""
    axes = tuple(range(1, theirs.ndim))
    gap = np.sqrt(np.sum((ours - theirs) ** 2, axis=axes))
    return gap / np.sqrt(np.sum(theirs**2, axis=axes))


@pytest.mark.parametrize("law", CLOSED_FORMS)
def test_closed_forms_are_the_derivatives(law):
    """Anisotropic, three facets: attitude and every surface parameter to 1e-9 relative."""
    case = bodies(1)

    def ours(sun, obs, normals, area, params, u):
        return closed_form(sun[None], obs[None], normals, area, law, params, u)

    result = jax.jit(jax.vmap(ours))(*case)
    value, turn, slopes = jax.jit(jax.vmap(lambda *c: by_autodiff(law, *c)))(*case)
    value, turn = np.asarray(value), np.asarray(turn)
    assert np.all(value > 0.0)
    several = np.sum(np.asarray(result.flux[:, 0]) > 0.0, axis=1) > 1
    assert several.sum() > 200
    assert relative(result.flux.sum(axis=(1, 2))[:, None], value[:, None]).max() < 1e-12
    assert relative(result.attitude[:, 0], turn).max() < 1e-9
    for name, slope in slopes.items():
        mine, theirs = np.asarray(result.parameters[name][:, 0]), np.asarray(slope)
        assert np.max(np.abs(mine - theirs) / (np.abs(theirs) + 1e-300)) < 1e-9, name
    # and of the magnitude, (17) and (22)
    mag = magnitude_gradient(jnp.asarray(value), result.attitude[:, 0])
    assert relative(mag, -MAGNITUDE_PER_NEPER * turn / value[:, None]).max() < 1e-9
    # rank one, and two axes that span what is not seen
    g = np.asarray(mag)
    assert np.all(np.linalg.matrix_rank(g[:, :, None] * g[:, None, :]) == 1)
    null = np.asarray(nullspace(mag, case[2][:, 0]))
    size = np.linalg.norm(g, axis=1)[:, None, None]
    np.testing.assert_allclose(null @ g[:, :, None] / size, 0.0, atol=1e-12)
    np.testing.assert_allclose(null @ np.swapaxes(null, 1, 2) - np.eye(2), 0.0, atol=1e-12)


def test_isotropic_facets_without_axes():
    """(24): one exponent, no axes; also against the anisotropic form at nu = nv."""
    law = CLOSED_FORMS[1]
    sun, obs, normals, area, params, u = bodies(2, cases=200)
    params = {k: v for k, v in params.items() if k != "nv"}

    def ours(sun, obs, normals, area, params):
        return closed_form(sun[None], obs[None], normals, area, law, params)

    result = jax.jit(jax.vmap(ours))(sun, obs, normals, area, params)
    _, turn, slopes = jax.jit(
        jax.vmap(lambda s, o, n, a, p: by_autodiff(law, s, o, n, a, p, None))
    )(sun, obs, normals, area, params)
    assert relative(result.attitude[:, 0], np.asarray(turn)).max() < 1e-9
    np.testing.assert_allclose(result.parameters["nu"][:, 0], slopes["nu"], rtol=1e-9, atol=1e-300)
    both = params | {"nv": params["nu"]}
    split = jax.vmap(lambda s, o, n, a, p, u: closed_form(s[None], o[None], n, a, law, p, u))(
        sun, obs, normals, area, both, u
    )
    np.testing.assert_allclose(split.attitude, result.attitude, rtol=1e-9, atol=1e-12)
    total = split.parameters["nu"] + split.parameters["nv"]
    np.testing.assert_allclose(total, result.parameters["nu"], rtol=1e-9, atol=1e-300)


def test_rank_and_nullspace_of_one_isotropic_facet():
    """(19) with its braces in place, and (20), (21), from C₁ and C₂ by differentiation."""
    sun, obs, normals, area, params, u = bodies(3, facets=1)
    params = params | {"nv": params["nu"]}
    law, sigma = CLOSED_FORMS[1], 0.07
    value, turn, _ = jax.jit(jax.vmap(lambda *c: by_autodiff(law, *c)))(
        sun, obs, normals, area, params, u
    )
    g = np.asarray(magnitude_gradient(value, turn))
    fisher = g[:, :, None] * g[:, None, :] / sigma**2
    assert np.all(np.linalg.matrix_rank(fisher) == 1)

    n, s, o = (np.asarray(x) for x in (normals[:, 0], sun, obs))
    coefficient = jax.jit(jax.vmap(lambda *c: _slopes_by_cosines(law, *c)))
    c = np.asarray(coefficient(sun, obs, normals[:, 0], params)) / np.asarray(value)[:, None]
    c = c * np.asarray(area)
    cross = np.stack([np.cross(n, e) for e in np.eye(3)], axis=-1)  # [n×]
    oo, ss, os = (a[:, :, None] * b[:, None, :] for a, b in ((o, o), (s, s), (o, s)))
    c1, c2 = (x[:, None, None] for x in c.T)
    braces = c1**2 * oo + c2**2 * ss + c1 * c2 * (os + np.swapaxes(os, 1, 2))
    closed = MAGNITUDE_PER_NEPER**2 / sigma**2 * cross @ braces @ np.swapaxes(cross, 1, 2)
    size = np.trace(fisher, axis1=1, axis2=2)[:, None, None]
    np.testing.assert_allclose(closed / size, fisher / size, rtol=0, atol=1e-9)

    null = np.asarray(nullspace(jnp.asarray(g), normals[:, 0]))
    length = np.linalg.norm(g, axis=1)
    np.testing.assert_allclose(null @ g[:, :, None] / length[:, None, None], 0.0, atol=1e-12)
    np.testing.assert_allclose(null @ np.swapaxes(null, 1, 2) - np.eye(2), 0.0, atol=1e-12)
    np.testing.assert_allclose(null[:, 0], n, atol=1e-7)  # g ⟂ n to rounding of a steep glint
    w = c[:, :1] * o + c[:, 1:] * s
    beta = w - n * np.sum(w * n, axis=1, keepdims=True)  # (20b), (21)
    beta /= np.linalg.norm(beta, axis=1, keepdims=True)
    np.testing.assert_allclose(null[:, 1], beta, atol=1e-6)


def _slopes_by_cosines(law, sun, obs, normal, params):
    """∂f/∂(o·n) and ∂f/∂(s·n) of an isotropic facet of unit area, all else held: f C₁ and f C₂."""

    def flux(cosines):
        xa, xb = cosines
        c = jnp.linalg.norm(sun + obs) / 2.0
        p = {k: v[0] for k, v in params.items()}
        lobe = (p["nu"] + 1.0) / (8.0 * jnp.pi) * ((xa + xb) / (2.0 * c)) ** p["nu"]
        fresnel = p["r_spec"] + (1.0 - p["r_spec"]) * (1.0 - c) ** 5
        assert law == "ashikhmin-shirley-distribution"
        spec = lobe * fresnel / (xa + xb - xa * xb)
        k2 = 28.0 / (23.0 * jnp.pi) * p["r_diff"] * (1.0 - p["r_spec"])
        diff = k2 * (1.0 - (1.0 - xa / 2.0) ** 5) * (1.0 - (1.0 - xb / 2.0) ** 5)
        return (spec + diff) * xa * xb

    return jax.grad(flux)(jnp.stack([obs @ normal, sun @ normal]))


def test_what_does_not_change_has_no_rank_and_still_two_directions():
    """A diffuse facet lit and seen face-on: the gradient vanishes; dark: magnitude and all."""
    axis = jnp.asarray([[0.0, 0.0, 1.0]])
    null = np.asarray(nullspace(jnp.zeros((1, 3)), axis))[0]
    np.testing.assert_allclose(null @ null.T, np.eye(2), atol=1e-15)
    np.testing.assert_array_equal(null[0], axis[0])
    assert not np.any(magnitude_gradient(jnp.zeros(1), jnp.zeros((1, 3))))


def test_the_sign_is_that_of_hinks():
    """δα turns the body's view: a Lambertian seen along its normal, lit at 60°, towards x.

    x_B = cos 60°; δα about y brings the Sun's body-frame direction up by δα_y's sign: s × n.
    """
    s = jnp.array([[np.sqrt(0.75), 0.0, 0.5]])
    n = jnp.array([[0.0, 0.0, 1.0]])

    def flux(sun, obs):
        return flux_brdf(sun, obs, n, jnp.ones(1), "lambertian", {"r_diff": np.pi})

    value, gradient = attitude_gradient(flux, s, n)
    assert value[0] == pytest.approx(0.5)
    np.testing.assert_allclose(gradient[0], np.cross(s[0], n[0]), atol=1e-15)
