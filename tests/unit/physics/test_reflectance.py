"""Each reflectance law against quadrature, hand-computed numbers and its printed form."""

import math

import numpy as np
import pytest

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.physics import reflectance
from lcbayes.physics.brightness import flux, flux_brdf
from lcbayes.physics.reflectance import LAWS, Geometry, geometry

Z, X = np.array([[0.0, 0.0, 1.0]]), np.array([[1.0, 0.0, 0.0]])

CASES = [
    ("lambertian", {"r_diff": 1.0}),
    ("non-lambertian", {"r_diff": 1.0}),
    ("ashikhmin-shirley", {"r_diff": 1.0, "r_spec": 0.0, "nu": 10.0, "nv": 10.0}),
    ("ashikhmin-shirley", {"r_diff": 1.0, "r_spec": 0.9, "nu": 5.0, "nv": 200.0}),
    ("ashikhmin-shirley", {"r_diff": 0.0, "r_spec": 1.0, "nu": 300.0, "nv": 80.0}),
    ("ashikhmin-shirley", {"r_diff": 1.0, "r_spec": 1.0, "nu": 0.0, "nv": 0.0}),
    ("ashikhmin-shirley-distribution", {"r_diff": 1.0, "r_spec": 0.9, "nu": 5.0, "nv": 200.0}),
    ("ashikhmin-shirley-distribution", {"r_diff": 0.0, "r_spec": 1.0, "nu": 300.0, "nv": 80.0}),
    ("ashikhmin-shirley-distribution", {"r_diff": 1.0, "r_spec": 1.0, "nu": 0.0, "nv": 0.0}),
    ("cook-torrance", {"r_diff": 0.0, "r_spec": 0.9, "m": 0.3}),
    ("cook-torrance", {"r_diff": 0.4, "r_spec": 0.6, "m": 0.15}),
    ("cook-torrance", {"r_diff": 0.9, "r_spec": 0.04, "m": 0.6}),
    ("blinn-phong", {"r_diff": 0.0, "r_spec": 1.0, "n": 0.0}),
    ("blinn-phong", {"r_diff": 0.3, "r_spec": 0.7, "n": 50.0}),
    ("lommel-seeliger-lambert", {"w": 1.0, "a": 0.5, "d": 0.1, "k": -0.3, "c": 0.1}),
    ("lommel-seeliger-lambert", {"w": 1.0, "a": 0.0, "d": 0.1, "k": 0.0, "c": 1.0}),
]


def directions(mu, azimuth):
    s = np.sqrt(1.0 - mu**2)
    return np.stack([s * np.cos(azimuth), s * np.sin(azimuth), mu], axis=-1)


def unit(rng, n):
    v = rng.normal(size=(n, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def f_r(law, params, sun, obs, u_axes=X):
    """f_r of one facet facing z, zero where it is not lit and seen."""
    result, lit = geometry(jnp.asarray(sun), jnp.asarray(obs), jnp.asarray(Z), jnp.asarray(u_axes))
    return np.asarray(jnp.where(lit, LAWS[law].brdf(result, params), 0.0))[:, 0]


def directional_albedo(brdf, incidence, n_mu=200, n_azimuth=400):
    """∫ f_r μ dω over the hemisphere: Gauss-Legendre in μ, equal steps in azimuth."""
    mu, w = np.polynomial.legendre.leggauss(n_mu)
    mu, w = 0.5 * (mu + 1.0), 0.5 * w
    azimuth = (np.arange(n_azimuth) + 0.5) * 2.0 * np.pi / n_azimuth
    obs = directions(np.repeat(mu, n_azimuth), np.tile(azimuth, n_mu))
    sun = np.broadcast_to(directions(np.cos(incidence), 0.4), obs.shape)
    weight = np.repeat(w * mu, n_azimuth) * 2.0 * np.pi / n_azimuth
    return float(brdf(sun, obs) @ weight)


@pytest.mark.parametrize(("law", "params"), CASES)
def test_no_law_reflects_more_light_than_arrives(law, params):
    for incidence in np.deg2rad([0.0, 30.0, 60.0, 80.0, 88.0]):
        albedo = directional_albedo(lambda s, o: f_r(law, params, s, o), incidence)
        assert 0.0 < albedo <= 1.0 + 1e-6, (incidence, albedo)


@pytest.mark.parametrize(("law", "params"), CASES)
def test_sun_and_observer_may_change_places(law, params):
    rng = np.random.default_rng(1)
    sun, obs = (directions(rng.uniform(0, 1, 300), rng.uniform(0, 7, 300)) for _ in range(2))
    forth, back = f_r(law, params, sun, obs), f_r(law, params, obs, sun)
    assert np.median(forth) > 0.0
    np.testing.assert_allclose(forth, back, rtol=1e-12)


def test_albedo_at_normal_incidence_is_what_the_parameters_say():
    def at_zenith(law, **params):
        return directional_albedo(lambda s, o: f_r(law, params, s, o), 0.0)

    assert at_zenith("lambertian", r_diff=0.3) == pytest.approx(0.3, rel=1e-10)
    # 23/28 is ∫ 2μ[1 − (1 − μ/2)⁵]dμ, 31/32 the factor of the incident beam
    assert at_zenith("non-lambertian", r_diff=1.0) == pytest.approx(23 / 28 * 31 / 32, rel=1e-10)
    assert at_zenith("blinn-phong", r_diff=0.2, r_spec=0.5, n=50.0) == pytest.approx(0.7, rel=1e-8)
    # Without its Fresnel term, sharp: everything that is reflected specularly is r_spec.
    assert at_zenith(
        "ashikhmin-shirley", r_diff=0.0, r_spec=0.5, nu=2000.0, nv=2000.0
    ) == pytest.approx(0.5, abs=1e-3)
    assert at_zenith("cook-torrance", r_diff=0.0, r_spec=0.5, m=0.05) == pytest.approx(
        0.5, abs=3e-3
    )


def test_cook_torrance_stays_below_its_normal_reflectance_face_on():
    for m in (0.1, 0.2, 0.4):
        params = {"r_diff": 0.0, "r_spec": 0.3, "m": m}
        assert directional_albedo(
            lambda s, o, p=params: f_r("cook-torrance", p, s, o), 0.0
        ) <= 0.3 * (1 + 1e-4)


def test_the_two_ashikhmin_shirley_forms_differ_at_60_degrees():
    # R_spec = R_diff = 0.5, n_u = n_v = 100: the pair of albedos quoted for the two forms
    params = {"r_diff": 0.5, "r_spec": 0.5, "nu": 100.0, "nv": 100.0}
    result = [
        directional_albedo(lambda s, o, law=law: f_r(law, params, s, o), np.pi / 3)
        for law in ("ashikhmin-shirley", "ashikhmin-shirley-distribution")
    ]
    np.testing.assert_allclose(result, [0.63, 0.36], atol=0.005)
    # A sharp lobe at 60°: F in one form, F/3 in the other.
    sharp = {"r_diff": 0.0, "r_spec": 0.4, "nu": 3000.0}
    full, third = (
        directional_albedo(
            lambda s, o, law=law: f_r(law, sharp, s, o), np.pi / 3, n_mu=800, n_azimuth=1600
        )
        for law in ("ashikhmin-shirley", "ashikhmin-shirley-distribution")
    )
    assert full == pytest.approx(0.4 + 0.6 / 32, rel=0.03)
    assert full / third == pytest.approx(3.0, rel=0.03)


# Hand-computed numbers: Sun at 60° along +x, observer at 60° along −x, so that h = n, c = ½.
MIRROR = (directions(np.array([0.5]), 0.0), directions(np.array([0.5]), np.pi))
# Sun overhead, observer at 60° towards x: h at 30° from the normal, in the plane of u; c = cos 30°.
SIDE = (directions(np.array([1.0]), 0.0), directions(np.array([0.5]), 0.0))


def test_hand_computed_values():
    c30 = math.sqrt(3.0) / 2.0
    assert f_r("lambertian", {"r_diff": 0.5}, *MIRROR)[0] == pytest.approx(0.5 / math.pi)
    assert f_r("non-lambertian", {"r_diff": 0.5}, *MIRROR)[0] == pytest.approx(
        0.5 / math.pi * (781 / 1024) ** 2  # 1 − (3/4)⁵ = 781/1024
    )
    p = {"r_diff": 0.3, "r_spec": 0.5, "nu": 8.0, "nv": 3.0}
    diffuse = 28 * 0.3 * 0.5 / (23 * math.pi)
    scale = 6.0 / (8 * math.pi)  # √(9·4)/8π
    fresnel = 0.5 + 0.5 / 32
    at_mirror = diffuse * (781 / 1024) ** 2
    assert f_r("ashikhmin-shirley", p, *MIRROR)[0] == pytest.approx(
        at_mirror + scale * fresnel / (0.5 * 0.5)
    )
    assert f_r("ashikhmin-shirley-distribution", p, *MIRROR)[0] == pytest.approx(
        at_mirror + scale * fresnel / 0.75
    )
    # h lies towards u: the exponent is n_u; turn the axes by 90° and it is n_v.
    fresnel = 0.5 + 0.5 * (1 - c30) ** 5
    at_side = diffuse * (31 / 32) * (781 / 1024)
    assert f_r("ashikhmin-shirley", p, *SIDE)[0] == pytest.approx(
        at_side + scale * fresnel / (c30 * 1.0) * c30**8
    )
    assert f_r("ashikhmin-shirley-distribution", p, *SIDE, u_axes=np.array([[0.0, 1.0, 0.0]]))[
        0
    ] == pytest.approx(at_side + scale * fresnel / (1 + 0.5 - 0.5) * c30**3)
    # h = n: D = 1/(πm²), G = min(1, 2·1·½/½) = 1; F₀ = 1/9 is glass of n = 2.
    c, g = 0.5, math.sqrt(4 + 0.25 - 1)
    fresnel = 0.5 * ((g - c) / (g + c)) ** 2
    fresnel *= 1 + ((c * (g + c) - 1) / (c * (g - c) + 1)) ** 2
    assert f_r("cook-torrance", {"r_diff": 0.0, "r_spec": 1 / 9, "m": 0.5}, *MIRROR)[
        0
    ] == pytest.approx(fresnel / (math.pi * 0.25) / (4 * 0.25))
    # tan²30° = 1/3, cos⁴30° = 9/16; G = min(1, 2 c30 ½/c30, 2 c30/c30) = 1
    g = math.sqrt(4 + 0.75 - 1)
    fresnel = 0.5 * ((g - c30) / (g + c30)) ** 2
    fresnel *= 1 + ((c30 * (g + c30) - 1) / (c30 * (g - c30) + 1)) ** 2
    lobe = math.exp(-(1 / 3) / 0.25) / (math.pi * 0.25 * 9 / 16)
    assert f_r("cook-torrance", {"r_diff": 0.2, "r_spec": 0.8 / 9, "m": 0.5}, *SIDE)[
        0
    ] == pytest.approx(0.2 / math.pi + 0.8 * lobe * fresnel / 2.0)
    assert f_r("blinn-phong", {"r_diff": 0.1, "r_spec": 0.5, "n": 2.0}, *SIDE)[0] == pytest.approx(
        0.1 / math.pi + 0.5 * 24 / (8 * math.pi * 2.5) * 0.75
    )
    phase = 0.3 * math.exp(-(math.pi / 3) / 0.2) - 0.1 * math.pi / 3 + 1
    assert f_r(
        "lommel-seeliger-lambert", {"w": 0.6, "a": 0.3, "d": 0.2, "k": -0.1, "c": 0.1}, *SIDE
    )[0] == pytest.approx(0.6 / (4 * math.pi) * phase * (1 / 1.5 + 0.1))


def test_exponent_agrees_with_the_angle_in_the_facets_plane():
    """Against z of Hinks' (11) with numpy, for general directions and axes."""
    rng = np.random.default_rng(3)
    sun, obs = (directions(rng.uniform(0.05, 1, 200), rng.uniform(0, 7, 200)) for _ in range(2))
    p = {"r_diff": 0.0, "r_spec": 1.0, "nu": 40.0, "nv": 7.0}
    h = sun + obs
    h /= np.linalg.norm(h, axis=1, keepdims=True)
    z = (40.0 * h[:, 0] ** 2 + 7.0 * h[:, 1] ** 2) / (1.0 - h[:, 2] ** 2)
    mu0, mu = sun[:, 2], obs[:, 2]
    expected = math.sqrt(41 * 8) / (8 * math.pi) * h[:, 2] ** z / (mu0 + mu - mu0 * mu)
    np.testing.assert_allclose(f_r("ashikhmin-shirley-distribution", p, sun, obs), expected)


def test_isotropic_facets_need_no_axes():
    rng = np.random.default_rng(4)
    sun, obs = (directions(rng.uniform(0, 1, 50), rng.uniform(0, 7, 50)) for _ in range(2))
    args = (jnp.asarray(sun), jnp.asarray(obs), jnp.asarray(Z), jnp.ones(1), "ashikhmin-shirley")
    p = {"r_diff": 0.2, "r_spec": 0.6, "nu": 30.0}
    with_axes = flux_brdf(*args, p | {"nv": 30.0}, jnp.asarray(X))
    np.testing.assert_allclose(flux_brdf(*args, p), with_axes, rtol=1e-12)
    with pytest.raises(ValueError, match="u_axes"):
        flux_brdf(*args, p | {"nv": 31.0})


# What the papers print, where it is wrong; each test fails if the misprint were right.


def test_printed_non_lambertian_makes_light():
    def printed(sun, obs):
        return (1 - (1 - sun[:, 2] / 2) ** 5) * (1 - (1 - obs[:, 2] / 2) ** 5)

    assert directional_albedo(printed, 0.0) == pytest.approx(2.5, abs=0.005)


def test_printed_blinn_phong_makes_light():
    def printed(sun, obs):
        h = sun + obs
        n = 50
        scale = (n + 2) * (n + 4) / (8 * math.pi * (n + 2 ** (-n / 2)))
        return scale * h[:, 2] / np.linalg.norm(h, axis=1)

    assert directional_albedo(printed, 0.0) == pytest.approx(6.4, abs=0.05)


def cook_torrance_as_printed(sun, obs, m, f0, lobe, g_of):
    h = sun + obs
    h /= np.linalg.norm(h, axis=1, keepdims=True)
    mu0, mu, mu_h, c = sun[:, 2], obs[:, 2], h[:, 2], np.sum(obs * h, axis=1)
    n = (1 + math.sqrt(f0)) / (1 - math.sqrt(f0))
    g = g_of(n**2 + c**2 - 1)
    fresnel = 0.5 * ((g - c) / (g + c)) ** 2 * (1 + ((c * (g + c) - 1) / (c * (g - c) + 1)) ** 2)
    shadow = np.minimum(1.0, 2 * mu_h * np.minimum(mu0, mu) / c)
    tan = np.sqrt(np.maximum(1 - mu_h**2, 0)) / mu_h
    density = np.exp(lobe(tan, m)) / (math.pi * m**2 * mu_h**4)
    return density * shadow * fresnel / (4 * mu0 * mu)


def test_printed_cook_torrance_makes_light_and_its_fresnel_term_is_off():
    m, f0 = 0.5, 0.3
    right = {"m": m, "f0": f0, "lobe": lambda t, m: -(t**2) / m**2, "g_of": np.sqrt}
    wrong_lobe = right | {"lobe": lambda t, m: t / m**2}
    wrong_g = right | {"g_of": lambda x: x}

    def albedo(form):
        return directional_albedo(lambda s, o: cook_torrance_as_printed(s, o, **form), 0.0)

    ours = directional_albedo(
        lambda s, o: f_r("cook-torrance", {"r_diff": 0.0, "r_spec": f0, "m": m}, s, o), 0.0
    )
    assert albedo(right) == pytest.approx(ours, rel=1e-10)
    assert ours <= f0
    assert albedo(wrong_lobe) > 1.0
    assert albedo(wrong_g) > 1.5 * f0
    # At normal incidence (c = 1) Fresnel's reflectance must be F₀ itself.
    n = (1 + math.sqrt(f0)) / (1 - math.sqrt(f0))

    def normal(g):
        return 0.5 * ((g - 1) / (g + 1)) ** 2 * (1 + (g / g) ** 2)

    assert normal(n) == pytest.approx(f0)
    assert normal(n**2) > 2 * f0


def test_printed_ashikhmin_shirley_angle_depends_on_more_than_the_plane():
    """cos β = u_h·u_v: the exponent at h → n would be n_v from any side, and u, v change places."""
    p = {"r_diff": 0.0, "r_spec": 1.0, "nu": 400.0, "nv": 4.0}
    sun = np.array([[0.0, 0.0, 1.0]])
    towards_u = directions(np.array([0.8]), 0.0)
    towards_v = directions(np.array([0.8]), np.pi / 2)
    # n_u = 400 makes the lobe narrow along u.
    assert f_r("ashikhmin-shirley", p, sun, towards_u)[0] < 1e-3
    assert f_r("ashikhmin-shirley", p, sun, towards_v)[0] > 0.5

    def printed(obs):
        h = sun[0] + obs[0]
        h /= np.linalg.norm(h)
        cos2 = h[1] ** 2
        return h[2] ** (400.0 * cos2 + 4.0 * (1 - cos2))

    assert printed(towards_u) > 0.7 > printed(towards_v)


def test_wang_4_exponent_is_not_the_isotropic_one():
    """z = r/(1 − c_hn²) exceeds r everywhere; the isotropic limit of Hinks' (11) is r itself."""
    p = {"r_diff": 0.0, "r_spec": 1.0, "nu": 20.0}
    ours = f_r("ashikhmin-shirley-distribution", p, *SIDE)[0]
    c30 = math.sqrt(3.0) / 2.0
    assert ours == pytest.approx(21 / (8 * math.pi) * c30**20)
    assert c30 ** (20 / (1 - c30**2)) < 1e-3 * c30**20


def hinks_numbers():
    """One facet, anisotropic, in general position; everything as plain floats."""
    rng = np.random.default_rng(8)
    sun, obs = directions(np.array([0.7]), 0.3), directions(np.array([0.6]), 2.1)
    return rng, sun, obs


def magnitude_of_facet(params, sun, obs, normal, u):
    sent = flux_brdf(
        sun[None],
        obs[None],
        normal[None],
        jnp.ones(1),
        "ashikhmin-shirley-distribution",
        params,
        u[None],
    )
    return -2.5 * jnp.log10(sent[0])


def test_hinks_18_with_corrected_d_is_the_attitude_gradient_of_the_magnitude():
    """(17) with (18a-d): A = exp(−[δα×])A_true, so body vectors turn by −δα; axes stay."""
    _, sun, obs = hinks_numbers()
    s, o = jnp.asarray(sun[0]), jnp.asarray(obs[0])
    n, u = jnp.asarray(Z[0]), jnp.asarray(X[0])
    p = {"r_diff": 0.4, "r_spec": 0.3, "nu": 25.0, "nv": 6.0}

    def turned(delta):
        x, y, z = delta
        cross = jnp.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        rotate = jax.scipy.linalg.expm(cross)  # the true attitude is exp([δα×]) Â
        return magnitude_of_facet(p, rotate @ s, rotate @ o, n, u)

    gradient = jax.jit(jax.grad(turned))(jnp.zeros(3))
    h = (s + o) / jnp.linalg.norm(s + o)
    v = jnp.cross(n, u)
    a, b, xn, xu, xv = (float(q) for q in (o @ n, s @ n, h @ n, h @ u, h @ v))
    nu, nv = p["nu"], p["nv"]
    z = (nu * xu**2 + nv * xv**2) / (1 - xn**2)
    fresnel = p["r_spec"] + (1 - p["r_spec"]) * (1 - float(s @ h)) ** 5
    spec = math.sqrt((nu + 1) * (nv + 1)) / (8 * math.pi) * xn**z * fresnel / (a + b - a * b)
    k2 = 28 * p["r_diff"] / (23 * math.pi) * (1 - p["r_spec"])
    wa, wb = 1 - (1 - a / 2) ** 5, 1 - (1 - b / 2) ** 5
    total = spec + k2 * wa * wb
    c1 = spec / total * (z / (a + b) - (1 - b) / (a + b - a * b))
    c1 += 2.5 * k2 / total * wb * (1 - a / 2) ** 4 + 1 / a
    c2 = spec / total * (z / (a + b) - (1 - a) / (a + b - a * b))
    c2 += 2.5 * k2 / total * wa * (1 - b / 2) ** 4 + 1 / b
    cu = 2 * (nu - nv) * spec / total * math.log(xn) * xu * xv**2 / (xu**2 + xv**2) ** 2
    front = -2 * (nu - nv) * spec / total * math.log(xn) * xv * xu**2
    cv, cv_printed = front / (xu**2 + xv**2) ** 2, front / (xu**2 + xn**2) ** 2

    def eq17(cv):
        vector = c1 * jnp.cross(o, n) + c2 * jnp.cross(s, n)
        vector += cu * jnp.cross(h, u) + cv * jnp.cross(h, v)
        return -2.5 / math.log(10) * vector

    np.testing.assert_allclose(gradient, eq17(cv), rtol=1e-9)
    assert not np.allclose(gradient, eq17(cv_printed), rtol=1e-2)


def test_hinks_23_with_corrected_a_are_the_parameter_gradients_of_the_magnitude():
    _, sun, obs = hinks_numbers()
    s, o = jnp.asarray(sun[0]), jnp.asarray(obs[0])
    n, u = jnp.asarray(Z[0]), jnp.asarray(X[0])
    p = {"r_diff": 0.4, "r_spec": 0.3, "nu": 25.0, "nv": 6.0}
    gradient = jax.jit(jax.grad(magnitude_of_facet))(p, s, o, n, u)
    h = (s + o) / jnp.linalg.norm(s + o)
    a, b, xn, xu, xv, sh = (
        float(q) for q in (o @ n, s @ n, h @ n, h @ u, h @ jnp.cross(n, u), s @ h)
    )
    z = (25.0 * xu**2 + 6.0 * xv**2) / (1 - xn**2)
    fresnel = 0.3 + 0.7 * (1 - sh) ** 5
    spec = math.sqrt(26 * 7) / (8 * math.pi) * xn**z * fresnel / (a + b - a * b)
    diff = 28 * 0.4 / (23 * math.pi) * 0.7 * (1 - (1 - a / 2) ** 5) * (1 - (1 - b / 2) ** 5)
    front = -2.5 / (math.log(10) * (spec + diff))
    assert gradient["r_spec"] == pytest.approx(
        front * (spec / fresnel * (1 - (1 - sh) ** 5) - diff / 0.7)
    )
    printed = front * (spec / fresnel * (1 - sh**5) - diff / 0.7)
    assert gradient["r_spec"] != pytest.approx(printed, rel=1e-2)
    assert gradient["r_diff"] == pytest.approx(front * diff / 0.4)
    log = math.log(xn) / (1 - xn**2)
    assert gradient["nu"] == pytest.approx(front * spec * (1 / 52 + log * xu**2))
    assert gradient["nv"] == pytest.approx(front * spec * (1 / 14 + log * xv**2))


@pytest.mark.parametrize("law", list(LAWS))
def test_values_and_derivatives_stay_finite_everywhere(law):
    """Random and degenerate: grazing, back-lit, h along n, zero phase, opposite Sun, dark."""
    rng = np.random.default_rng(5)
    sun, obs = unit(rng, 60), unit(rng, 60)
    x, z = np.eye(3)[[0, 2]]
    tilt = np.array([math.sqrt(1 - 1e-14), 0.0, 1e-7])
    edge = [(z, z), (x, z), (z, x), (x, x), (x, -x), (z, -z), (-z, -z), (tilt, tilt), (tilt, z)]
    edge += [(tilt, tilt * [-1, 1, 1]), (directions(0.5, 0.0), directions(0.5, np.pi))]
    sun = jnp.asarray(np.concatenate([sun, [e[0] for e in edge]]))
    obs = jnp.asarray(np.concatenate([obs, [e[1] for e in edge]]))
    normals = jnp.asarray(np.concatenate([np.eye(3), -np.eye(3), unit(rng, 4), [tilt]]))
    axes = jnp.cross(normals, jnp.asarray(unit(rng, len(normals))))
    axes = axes / jnp.linalg.norm(axes, axis=1, keepdims=True)
    area = jnp.ones(len(normals))
    spec = LAWS[law].parameters
    for corner in ("lower", "upper", "inside"):
        params = {}
        for name, (low, high, _, _) in spec.items():
            inside = 3.0 if high > 1.0 else 0.5 * (low + high)
            params[name] = jnp.full(len(normals), {"lower": low, "upper": high}.get(corner, inside))
            if name == "nv":
                params[name] = params[name] * 0.7

        def total(sun, obs, normals, axes, area, params):
            return jnp.sum(flux_brdf(sun, obs, normals, area, law, params, axes))

        value, slopes = jax.value_and_grad(total, argnums=(0, 1, 2, 3, 4, 5))(
            sun, obs, normals, axes, area, params
        )
        assert np.isfinite(value)
        assert value >= 0.0
        for leaf in jax.tree.leaves(slopes):
            assert np.all(np.isfinite(leaf)), corner


@pytest.mark.parametrize("law", list(LAWS))
def test_derivatives_agree_with_differences(law):
    rng = np.random.default_rng(6)
    sun = jnp.asarray(directions(rng.uniform(0.3, 1, 5), rng.uniform(0, 7, 5)))
    obs = jnp.asarray(directions(rng.uniform(0.3, 1, 5), rng.uniform(0, 7, 5)))
    given = {"r_diff": 0.3, "r_spec": 0.4, "nu": 12.0, "nv": 5.0, "m": 0.4, "n": 7.0}
    given |= {"w": 0.7, "a": 0.3, "d": 0.2, "k": -0.2, "c": 0.1}
    names = list(LAWS[law].parameters)

    def value(theta):
        normal = theta[:3] / jnp.linalg.norm(theta[:3])
        u = jnp.cross(jnp.array([0.0, 1.0, 0.2]), normal)
        params = dict(zip(names, theta[3:], strict=True))
        return jnp.sum(
            flux_brdf(
                sun, obs, normal[None], jnp.ones(1), law, params, (u / jnp.linalg.norm(u))[None]
            )
        )

    theta = jnp.array([0.05, -0.1, 1.0, *(given[name] for name in names)])
    exact = jax.jit(jax.grad(value))(theta)
    step = 1e-5
    eye = jnp.eye(theta.size) * step
    numeric = jnp.array([(value(theta + e) - value(theta - e)) / (2 * step) for e in eye])
    np.testing.assert_allclose(exact, numeric, rtol=2e-6, atol=1e-8)


def test_diffuse_laws_agree_with_the_fast_kernels():
    rng = np.random.default_rng(7)
    sun, obs, normals = (jnp.asarray(unit(rng, n)) for n in (40, 40, 9))
    area = jnp.asarray(rng.uniform(1, 2, 9))
    for law, params in [
        ("lambertian", {"r_diff": 1.0}),
        ("non-lambertian", {"r_diff": 1.0}),
        ("lommel-seeliger-lambert", {"w": 4 * math.pi, "a": 0.0, "d": 0.1, "k": 0.0, "c": 0.2}),
    ]:
        expected = flux_brdf(sun, obs, normals, area, law, params)
        np.testing.assert_allclose(flux(sun, obs, normals, area, law, 0.2), expected, atol=1e-14)


def test_half_phase_at_every_angle():
    angle = np.array([0.0, 1e-9, 1e-5, 0.5, 2.0, np.pi - 1e-7])
    sun = np.tile([1.0, 0.0, 0.0], (6, 1))
    obs = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    c, phase = reflectance.half_phase(jnp.asarray(sun), jnp.asarray(obs))
    np.testing.assert_allclose(phase, angle, rtol=1e-8, atol=1e-11)
    np.testing.assert_allclose(c, np.cos(angle / 2), rtol=1e-6)


def test_every_law_states_what_it_needs():
    for name, law in LAWS.items():
        asked = set()

        class Recorder(dict):
            def __missing__(self, key, asked=asked):
                asked.add(key)
                return jnp.float64(0.5)

            def __contains__(self, key):
                return True

        one = jnp.full((1, 1), 0.5)
        law.brdf(Geometry(one, one, one, one, one, one, one), Recorder())
        assert asked == set(law.parameters), name
    with pytest.raises(ValueError, match="unknown law 'phong'; available: lambertian"):
        reflectance.get_law("phong")
