"""Brightness of convex primitives: against sums over their surfaces, and derivatives."""

from __future__ import annotations

import numpy as np
import pytest

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.physics.attitude import rotations
from lcbayes.physics.bodies.primitive_flux import KINDS, Primitive, body_flux, primitive_flux

LAMBERT = ("lambertian", {"r_diff": 0.6})
NON_LAMBERT = ("non-lambertian", {"r_diff": 0.6})
LOMMEL = ("lommel-seeliger-lambert", {"w": 0.3, "a": 0.2, "d": 0.1, "k": -0.1, "c": 0.2})
SHARP = ("ashikhmin-shirley", {"r_diff": 0.3, "r_spec": 0.4, "nu": 1e3})
GLOSSY = ("ashikhmin-shirley", {"r_diff": 0.3, "r_spec": 0.4, "nu": 100.0})
BRUSHED = ("ashikhmin-shirley", {"r_diff": 0.3, "r_spec": 0.4, "nu": 20.0, "nv": 300.0})
PHONG = ("blinn-phong", {"r_diff": 0.3, "r_spec": 0.4, "n": 30.0})
BECKMANN = ("cook-torrance", {"r_diff": 0.3, "r_spec": 0.4, "m": 0.1})


def _directions(count, seed, normals=None):
    """Sun and observer at phase angles up to 150 deg; with normals, the last half glint."""
    rng = np.random.default_rng(seed)
    h = rng.standard_normal((count, 3))
    if normals is not None:
        h[count // 2 :] = normals[rng.integers(len(normals), size=count - count // 2)]
        h += 0.01 * rng.standard_normal(h.shape)
    h /= np.linalg.norm(h, axis=1, keepdims=True)
    across = np.cross(h, rng.standard_normal(h.shape))
    across *= np.tan(np.deg2rad(rng.uniform(0, 75, (count, 1)))) / np.linalg.norm(
        across, axis=1, keepdims=True
    )
    both = np.stack([h + across, h - across])
    return both / np.linalg.norm(both, axis=2, keepdims=True)


def _brdf(law, p, mu0, mu, c, nh, hu, hv):
    """Reflectance, written anew from the papers."""
    if law == "lambertian":
        return p["r_diff"] / np.pi
    if law == "non-lambertian":
        return p["r_diff"] / np.pi * (1 - (1 - mu0 / 2) ** 5) * (1 - (1 - mu / 2) ** 5)
    if law == "lommel-seeliger-lambert":
        phase = 2 * np.arccos(c)
        factor = p["a"] * np.exp(-phase / p["d"]) + p["k"] * phase + 1
        return p["w"] / (4 * np.pi) * factor * (1 / (mu0 + mu) + p["c"])
    if law == "blinn-phong":
        n = p["n"]
        scale = (n + 2) * (n + 4) / (8 * np.pi * (n + 2 ** (-n / 2)))
        return p["r_diff"] / np.pi + p["r_spec"] * scale * nh**n
    if law == "cook-torrance":
        s = 1 - p["r_diff"]
        root = np.sqrt(p["r_spec"] / s)
        n = (1 + root) / (1 - root)
        g = np.sqrt(n**2 + c**2 - 1)
        fresnel = 0.5 * ((g - c) / (g + c)) ** 2
        fresnel = fresnel * (1 + ((c * (g + c) - 1) / (c * (g - c) + 1)) ** 2)
        lobe = np.exp(-(1 / nh**2 - 1) / p["m"] ** 2) / (np.pi * p["m"] ** 2 * nh**4)
        shadow = np.minimum(1, 2 * nh * np.minimum(mu, mu0) / c)
        return p["r_diff"] / np.pi + s * lobe * shadow * fresnel / (4 * mu * mu0)
    nu, nv = p["nu"], p.get("nv", p["nu"])
    across = np.maximum(hu**2 + hv**2, 1e-300)
    power = nh ** ((nu * hu**2 + nv * hv**2) / across)
    fresnel = p["r_spec"] + (1 - p["r_spec"]) * (1 - c) ** 5
    lobe = np.sqrt((nu + 1) * (nv + 1)) / (8 * np.pi) * power * fresnel / (c * np.maximum(mu0, mu))
    diffuse = 28 * p["r_diff"] / (23 * np.pi) * (1 - p["r_spec"])
    return lobe + diffuse * (1 - (1 - mu0 / 2) ** 5) * (1 - (1 - mu / 2) ** 5)


def _summed(elements, surface, sun, obs):
    """Σ f_r μ₀ μ dA over elements: normals, areas and u axes."""
    (normals, areas, u), (law, p) = elements, surface
    total = []
    for s, o in zip(sun, obs, strict=True):
        mu0, mu = normals @ s, normals @ o
        lit = (mu0 > 1e-12) & (mu > 1e-12)
        n, mu0, mu = normals[lit], mu0[lit], mu[lit]
        h = (s + o) / np.linalg.norm(s + o)
        result = _brdf(law, p, mu0, mu, s @ h, n @ h, u[lit] @ h, np.cross(n, u[lit]) @ h)
        total.append(np.sum(result * mu0 * mu * areas[lit]))
    return np.array(total)


def _round_side(radius, radius_top, length, count=100_000):
    phi = 2 * np.pi * (np.arange(count) + 0.5) / count
    e = np.stack([np.cos(phi), np.sin(phi), 0 * phi], axis=1)
    z = np.array([0, 0, 1.0])
    slant = np.hypot(length, radius - radius_top)
    u = ((radius_top - radius) * e + length * z) / slant
    n = (length * e + (radius - radius_top) * z) / slant
    return n, np.full(count, np.pi * (radius + radius_top) * slant / count), u


def _egg(x, y, z, count=700):
    """Elements x = D y of an ellipsoid, dA = |∂x/∂θ × ∂x/∂φ| dθ dφ."""
    theta, phi = np.meshgrid(
        np.pi * (np.arange(count) + 0.5) / count, np.pi * (np.arange(2 * count) + 0.5) / count
    )
    theta, phi, scale = theta.ravel(), phi.ravel(), np.array([x, y, z])
    d_theta = np.stack(
        [np.cos(theta) * np.cos(phi), np.cos(theta) * np.sin(phi), -np.sin(theta)], 1
    )
    d_phi = np.stack([-np.sin(theta) * np.sin(phi), np.sin(theta) * np.cos(phi), 0 * phi], 1)
    vector = np.cross(d_theta * scale, d_phi * scale)
    area = np.linalg.norm(vector, axis=1)
    n = vector / area[:, None]
    u = np.stack([-n[:, 1], n[:, 0], 0 * phi], 1)
    return n, area * (np.pi / count) ** 2, u / np.linalg.norm(u, axis=1, keepdims=True)


def _faces(*faces):
    normals, areas, u = zip(*faces, strict=True)
    return np.array(normals, float), np.array(areas, float), np.array(u, float)


X, Y, Z = np.eye(3)
CASES = {
    "box": (
        {"x": 1.0, "y": 2.0, "z": 0.5},
        lambda: _faces((X, 1, Y), (-X, 1, Y), (Y, 0.5, X), (-Y, 0.5, X), (Z, 2, Y), (-Z, 2, Y)),
    ),
    "plate": ({"x": 1.0, "y": 2.0}, lambda: _faces((Z, 2, Y))),
    "disc": ({"radius": 0.7}, lambda: _faces((Z, 0.49 * np.pi, X))),
    "cylinder": ({"radius": 0.7, "length": 2.0}, lambda: _round_side(0.7, 0.7, 2.0)),
    "cone": ({"radius": 0.7, "length": 0.5}, lambda: _round_side(0.7, 0.0, 0.5)),
    "frustum": (
        {"radius": 0.4, "radius_top": 0.9, "length": 1.0},
        lambda: _round_side(0.4, 0.9, 1.0),
    ),
    "sphere": ({"radius": 0.8}, lambda: _egg(0.8, 0.8, 0.8)),
    "ellipsoid": ({"x": 0.5, "y": 0.8, "z": 1.2}, lambda: _egg(0.5, 0.8, 1.2)),
}
DARK = ("lambertian", {"r_diff": 0.0})


@pytest.mark.parametrize(
    ("kind", "surface", "within"),
    [
        ("box", BRUSHED, 1e-12),
        ("plate", BRUSHED, 1e-12),
        ("disc", PHONG, 1e-12),
        ("cylinder", LAMBERT, 1e-7),
        ("cylinder", BRUSHED, 1e-5),
        ("frustum", NON_LAMBERT, 1e-7),
        ("frustum", SHARP, 5e-5),
        ("cone", LOMMEL, 2e-5),
        ("cone", BECKMANN, 3e-4),
        ("cone", BRUSHED, 5e-5),
        ("sphere", GLOSSY, 3e-4),
        ("sphere", BRUSHED, 5e-3),  # the u axis of the law is undefined at the poles
        ("ellipsoid", LAMBERT, 1e-5),
        ("ellipsoid", GLOSSY, 3e-4),
    ],
)
def test_flux_is_the_sum_over_the_surface(kind, surface, within):
    """Over the largest flux; ends and backs are tested below."""
    sizes, made = CASES[kind]
    elements = made()
    turn = rotations.constant_rate(jnp.ones(1), jnp.array([0.3, -0.8, 0.5]))[0]
    sun, obs = _directions(16, 1, elements[0])
    expected = _summed(elements, surface, sun, obs)
    sides = KINDS[kind].sides
    surfaces = dict.fromkeys(sides, DARK) | {sides[0]: surface}
    result = jax.jit(lambda s, o: primitive_flux(kind, sizes, surfaces, s, o, turn))(
        sun @ turn.T, obs @ turn.T
    )
    assert expected.max() > 0.01
    np.testing.assert_allclose(result, expected, rtol=0, atol=within * expected.max())


@pytest.mark.parametrize("kind", ["plate", "disc", "cylinder", "cone", "frustum"])
def test_ends_and_backs_are_flat_faces(kind):
    sizes, _ = CASES[kind]
    first, other = KINDS[kind].sides
    area = np.pi * np.array([0.4, 0.9]) ** 2
    if kind != "frustum":
        area = np.array([np.pi * 0.49, 0.0 if kind == "cone" else np.pi * 0.49])
    if kind == "plate":
        area = np.array([2.0, 0.0])
    if other == "back":
        area[1] = 0.0
    elements = _faces((-Z, area[0], X), (Z, area[1], X))
    sun, obs = _directions(8, 2, elements[0])
    result = primitive_flux(kind, sizes, {first: DARK, other: PHONG}, sun, obs)
    np.testing.assert_allclose(result, _summed(elements, PHONG, sun, obs), atol=1e-12)


def test_a_lambert_sphere_follows_the_textbook():
    """f = (2/3π) r_diff r² [sin α + (π − α) cos α] (Lambert; Russell 1916)."""
    phase = np.linspace(0, np.pi, 19)
    sun = jnp.tile(X, (19, 1))
    obs = jnp.stack([np.cos(phase), 0.6 * np.sin(phase), 0.8 * np.sin(phase)], axis=1)
    expected = 2 / (3 * np.pi) * 0.6 * 4 * (np.sin(phase) + (np.pi - phase) * np.cos(phase))
    for kind, sizes in (("sphere", {"radius": 2.0}), ("ellipsoid", dict.fromkeys("xyz", 2.0))):
        result = primitive_flux(kind, sizes, {"side": LAMBERT}, sun, obs)
        np.testing.assert_allclose(result, expected, rtol=0, atol=1e-12)


def test_limits_join():
    """Frustum, cylinder and cone; a body without height; surfaces that add up."""
    sun, obs = _directions(12, 3)

    def flux(kind, surface=SHARP, **sizes):
        return np.asarray(primitive_flux(kind, sizes, {"side": surface, "end": LAMBERT}, sun, obs))

    cylinder = flux("cylinder", radius=0.5, length=1.3)
    joined = flux("frustum", radius=0.5, radius_top=0.5, length=1.3)
    np.testing.assert_allclose(joined, cylinder, atol=2e-5)
    cone = flux("cone", radius=0.5, length=1.3)
    np.testing.assert_allclose(flux("frustum", radius=0.5, radius_top=0.0, length=1.3), cone)
    disc = flux("cylinder", radius=0.5, length=0.0)
    ends = 0.25 * 0.6 * sun[:, 2] * obs[:, 2] * (sun[:, 2] * obs[:, 2] > 0)
    np.testing.assert_allclose(disc, ends, atol=1e-15)
    both = flux("cylinder", [SHARP, PHONG], radius=0.5, length=1.3)
    phong = flux("cylinder", PHONG, radius=0.5, length=1.3)
    np.testing.assert_allclose(both + disc, cylinder + phong, atol=1e-14)


PARTS = {
    "frustum": ({"radius": 0.4, "radius_top": 0.9, "length": 1.0}, BRUSHED),
    "cylinder": ({"radius": 0.6, "length": 1.0}, LOMMEL),
    "ellipsoid": ({"x": 0.5, "y": 0.8, "z": 1.2}, PHONG),
    "sphere": ({"radius": 0.6}, PHONG),
    "box": ({"x": 0.5, "y": 0.8, "z": 1.2}, LAMBERT),
}


def _of(kind, sun, obs, nodes=None):
    """Flux (T,) of a vector: log sizes, logarithms of the law's parameters, a rotation."""
    sizes, (law, parameters) = PARTS[kind]
    start = np.log(np.array([*sizes.values(), *(abs(v) for v in parameters.values())]))
    sign = np.sign(list(parameters.values()))
    turn = rotations.constant_rate(jnp.ones(1), jnp.array([0.4, 0.2, -0.7]))[0]

    def flux(x):
        values = jnp.exp(x[:-3])
        own = dict(zip(sizes, values, strict=False))
        p = dict(zip(parameters, sign * values[len(sizes) :], strict=True))
        more = rotations.constant_rate(jnp.ones(1), x[-3:])[0]
        return primitive_flux(
            kind, own, {KINDS[kind].sides[0]: (law, p)}, sun, obs, more @ turn, nodes
        )

    return flux, np.concatenate([start, 1e-3 * np.ones(3)])


@pytest.mark.parametrize("kind", list(PARTS))
def test_derivatives_are_differences(kind):
    sun, obs = _directions(12, 4)
    flux, x = _of(kind, sun, obs)
    jacobian = np.asarray(jax.jit(jax.jacrev(flux))(x))
    steps = 1e-5 * np.eye(len(x))
    values = np.asarray(jax.jit(jax.vmap(flux))(np.concatenate([x + steps, x - steps])))
    expected = (values[: len(x)] - values[len(x) :]).T / 2e-5
    matter = np.abs(expected).max(axis=0) > 1e-4  # the rotation of a sphere does not
    assert matter.sum() == (4 if kind == "sphere" else len(x))
    np.testing.assert_allclose(jacobian, expected, rtol=0, atol=1e-3 * np.abs(expected).max())


@pytest.mark.slow
def test_second_derivatives_follow_the_terminator():
    """The limits of the integral move with the directions; to first order this does not matter."""
    sun, obs = _directions(12, 5)
    for kind in ("cylinder", "ellipsoid"):  # without and with divided intervals
        flux, x = _of(kind, sun, obs, 20)
        slope = jax.jit(jax.grad(lambda v, flux=flux: jnp.sum(flux(v))))
        along = np.zeros(len(x))
        along[-3:] = [0.6, -0.3, 0.7]
        second = jax.jit(lambda v, a, g=slope: jax.jvp(g, (v,), (a,))[1])(x, along)
        expected = (slope(x + 1e-5 * along) - slope(x - 1e-5 * along)) / 2e-5
        assert np.abs(expected).max() > 0.1
        np.testing.assert_allclose(second, expected, atol=1e-3 * np.abs(expected).max())


@pytest.mark.parametrize("surface", [SHARP, LOMMEL])
def test_special_directions_have_finite_derivatives(surface):
    """Along the axis, at full and at new phase, and where the lit or the visible part is empty."""
    sun = np.array([Z, Z, X, X, Z, Z, -Z, X, (X + Z) / np.sqrt(2)])
    obs = np.array([Z, -Z, X, -X, X, Y, -Z, Y, (X - Z) / np.sqrt(2)])
    sizes = [("cylinder", (0.5, 1.0)), ("cylinder", (0.5, 0.0)), ("frustum", (0.5, 0.5, 1.0))]
    sizes += [("cone", (0.5, 0.5)), ("frustum", (0.5, 0.2, 0.0)), ("sphere", (0.5,))]
    sizes += [("ellipsoid", (0.5, 0.5, 1.0))]

    def total(values, parameters, sun, obs):
        parts = [
            Primitive(kind, dict(zip(KINDS[kind].sizes, v, strict=True)), {"side": (surface[0], p)})
            for (kind, _), v, p in zip(sizes, values, parameters, strict=True)
        ]
        return jnp.sum(body_flux(parts, sun, obs, nodes=8))

    args = [v for _, v in sizes], [surface[1]] * len(sizes), sun, obs
    value, slopes = jax.jit(jax.value_and_grad(total, argnums=(0, 1, 2, 3)))(*args)
    assert value > 0.1
    assert all(np.isfinite(slope).all() for slope in jax.tree.leaves(slopes))


def test_an_interval_needs_few_nodes_however_narrow_the_lobe():
    """The errors that `NODES` states, against eight times as many nodes."""
    rng = np.random.default_rng(6)
    phi = rng.uniform(0, 2 * np.pi, 200)
    sun, obs = _directions(400, 7, np.stack([np.cos(phi), np.sin(phi), 0 * phi], axis=1))

    def of(exponent, nodes):
        surface = "blinn-phong", {"r_diff": 0.3, "r_spec": 0.5, "n": exponent}
        surfaces = {"side": surface, "end": DARK}
        return primitive_flux(
            "cylinder", {"radius": 1, "length": 1}, surfaces, sun, obs, None, nodes
        )

    exponents = jnp.array([10.0, 1e2, 1e3, 1e4, 1e5])
    coarse, fine = (
        np.asarray(jax.jit(jax.vmap(lambda z, n=n: of(z, n)))(exponents)) for n in (None, 192)
    )
    error = np.abs(coarse - fine).max(axis=1) / fine.max(axis=1)
    assert error.max() < 5e-5


@pytest.mark.parametrize(
    ("kind", "sizes", "surfaces", "message"),
    [
        ("dish", {"radius": 1.0}, {"side": LAMBERT}, "no formula for 'dish'"),
        ("sphere", {"x": 1.0}, {"side": LAMBERT}, "has the sizes radius; given: x"),
        ("plate", {"x": 1.0, "y": 1.0}, {"back": LAMBERT}, "'front' needs a surface"),
        ("box", {"x": 1.0, "y": 1.0, "z": 1.0}, {"side": LAMBERT, "end": LAMBERT}, "given"),
    ],
)
def test_wrong_descriptions_are_refused(kind, sizes, surfaces, message):
    with pytest.raises(ValueError, match=message):
        primitive_flux(kind, sizes, surfaces, jnp.eye(3), jnp.eye(3))
