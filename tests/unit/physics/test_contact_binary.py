"""Brightness of two ellipsoids that shade one another, against images of them."""

from __future__ import annotations

import numpy as np
import pytest

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.physics import brightness
from lcbayes.physics.bodies import contact_binary, facets
from lcbayes.physics.bodies.contact_binary import lobes

LAW, C, N = "lommel-seeliger-lambert", 0.1, 400
BODIES = {
    "two spheres in contact": (0.8, (1.0, 1.0), (1.0, 1.0), 1.0),
    "two spheres with a neck": (0.9, (1.0, 1.0), (1.0, 1.0), 0.75),
    "two ellipsoids": (0.7, (0.8, 1.1), (0.75, 0.9), 0.9),
}
PIXEL = 0.006


def hits(centre, axes, origin, toward):
    """Largest distance along rays (P, 3) toward (3,) at which they meet an ellipsoid, or −inf."""
    q, e = (origin - centre) / axes, toward / axes
    a, b, c = e @ e, q @ e, np.sum(q * q, axis=1) - 1.0
    square = b * b - a * c
    return np.where(square >= 0.0, (-b + np.sqrt(np.maximum(square, 0.0))) / a, -np.inf)


def image_flux(centres, axes, sun, obs):
    """Σ K/μ over the pixels of an orthographic image, times their area."""
    across = np.linalg.svd(obs[None])[2][1:]
    middle = centres.mean(axis=0)
    reach = np.max(np.linalg.norm(centres - middle, axis=1) + axes.max(axis=1))
    line = np.arange(-reach, reach, PIXEL)
    u, v = (x.ravel() for x in np.meshgrid(line, line))
    start = middle + u[:, None] * across[0] + v[:, None] * across[1]
    depth = np.stack([hits(c, x, start, obs) for c, x in zip(centres, axes, strict=True)])
    which = np.argmax(depth, axis=0)
    seen = np.isfinite(depth.max(axis=0))
    at, which = (start + depth.max(axis=0)[:, None] * obs)[seen], which[seen]
    normal = (at - centres[which]) / axes[which] ** 2
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    mu0, mu = normal @ sun, normal @ obs
    other = [hits(c, x, at, sun) for c, x in zip(centres, axes, strict=True)]
    shaded = np.where(which == 0, other[1], other[0]) > 1e-6
    lit = (mu0 > 0.0) & ~shaded
    return PIXEL**2 * np.sum((mu0 / (mu0 + mu) + C * mu0)[lit])


def directions(phase_deg, count=12):
    """Sun and observer around the body at some latitudes, (T, 3) each."""
    lon = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False) + 0.1
    lat = 0.5 * np.sin(2.0 * lon)
    toward = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=1)
    turn = np.radians(phase_deg)
    cos, sin = np.cos(turn), np.sin(turn)
    rotation = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return toward @ rotation.T, toward


def surface(centres, axes):
    """Area of the union, from its two parts on a fine grid of polar angle and azimuth."""
    theta = np.pi * (np.arange(1200) + 0.5) / 1200
    phi = 2.0 * np.pi * (np.arange(1200) + 0.5) / 1200
    theta, phi = (x.ravel() for x in np.meshgrid(theta, phi))
    u = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=1)
    total = 0.0
    for k in (0, 1):
        at = u * axes[k] + centres[k]
        outside = np.sum(((at - centres[1 - k]) / axes[1 - k]) ** 2, axis=1) > 1.0
        area = np.prod(axes[k]) * np.linalg.norm(u / axes[k], axis=1) * np.sin(theta)
        total += np.sum(area[outside]) * 2.0 * np.pi**2 / 1200**2
    return total


@pytest.mark.parametrize("phase_deg", [5.0, 30.0, 70.0])
@pytest.mark.parametrize("name", BODIES)
def test_flux_is_that_of_images(name, phase_deg):
    """Rays through the pixels of an image find what is seen and lit, without any patch."""
    body = lobes(*(jnp.asarray(x) for x in BODIES[name]))
    centres, axes = (np.asarray(x) for x in body)
    sun, obs = directions(phase_deg)
    expected = np.array([image_flux(centres, axes, s, o) for s, o in zip(sun, obs, strict=True)])
    expected /= surface(centres, axes)
    got = contact_binary.flux(jnp.asarray(sun), jnp.asarray(obs), body, LAW, jnp.asarray(C), N)
    error = (np.asarray(got) - expected) / expected.mean()
    assert np.abs(error.mean()) < 0.005
    assert np.std(error) < 0.003  # relative curves, whose scale is free, know the variation alone


def test_finer_patches_are_more_exact():
    body = lobes(*(jnp.asarray(x) for x in BODIES["two spheres in contact"]))
    centres, axes = (np.asarray(x) for x in body)
    sun, obs = directions(30.0)
    expected = np.array([image_flux(centres, axes, s, o) for s, o in zip(sun, obs, strict=True)])
    expected /= surface(centres, axes)
    args = jnp.asarray(sun), jnp.asarray(obs), body, LAW, jnp.asarray(C)
    coarse, fine = (
        np.sqrt(np.mean((np.asarray(contact_binary.flux(*args, n)) - expected) ** 2))
        for n in (100, 1600)
    )
    assert fine < 0.4 * coarse


def test_a_lobe_inside_the_other_is_not_seen():
    """The flux is that of one ellipsoid, which is convex."""
    body = lobes(0.2, jnp.array([0.9, 1.0]), jnp.array([0.8, 1.0]), 0.2)
    axes = np.array([1.0, 0.9, 0.72])  # but for the scale, of which the result is free
    u = facets.grid(3000)
    length = np.linalg.norm(u / axes, axis=1)
    area = length / np.sum(length)
    sun, obs = (jnp.asarray(x) for x in directions(40.0))
    normals = jnp.asarray(u / axes / length[:, None])
    expected = brightness.flux(sun, obs, normals, jnp.asarray(area), LAW, C)
    got = contact_binary.flux(sun, obs, body, LAW, jnp.asarray(C), N)
    np.testing.assert_allclose(got, expected, rtol=3e-3)


def test_the_ellipsoids_may_be_exchanged():
    """In the other order, and turned by half a turn about z, it is the same body."""
    sun, obs = directions(30.0)
    ba, cb = jnp.array([0.8, 1.1]), jnp.array([0.75, 0.9])
    turn = np.array([-1.0, -1.0, 1.0])
    one = contact_binary.flux(
        jnp.asarray(sun), jnp.asarray(obs), lobes(0.7, ba, cb, 0.9), LAW, jnp.asarray(C), N
    )
    exchanged = lobes(1.0 / 0.7, ba[::-1], cb[::-1], 0.9)
    other = contact_binary.flux(
        jnp.asarray(sun * turn), jnp.asarray(obs * turn), exchanged, LAW, jnp.asarray(C), N
    )
    np.testing.assert_allclose(other, one, rtol=1e-10)


def test_slopes_are_those_of_differences():
    sun, obs = (jnp.asarray(x) for x in directions(30.0, 6))

    @jax.jit
    def total(x):
        body = lobes(x[0], x[1:3], x[3:5], x[5])
        return jnp.sum(contact_binary.flux(sun, obs, body, LAW, x[6], 200) * jnp.arange(1.0, 7.0))

    x = np.array([0.8, 0.9, 1.1, 0.8, 0.95, 0.9, 0.1])
    slope = np.asarray(jax.jit(jax.grad(total))(jnp.asarray(x)))
    step = 1e-6
    for k, expected in enumerate(slope):
        up, down = x.copy(), x.copy()
        up[k] += step
        down[k] -= step
        difference = (float(total(jnp.asarray(up))) - float(total(jnp.asarray(down)))) / (2 * step)
        assert difference == pytest.approx(expected, rel=1e-5, abs=1e-7)
