"""The simulators of the fault benchmarks, which share no code with the package."""

from __future__ import annotations

import ast
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks import _asteroids as asteroids
from benchmarks import _satellites as satellites
from benchmarks._satellites import Body, Fault

ROOT = Path(__file__).parents[3]
PHASES = np.radians([0.0, 20.0, 75.0, 120.0])


@pytest.mark.parametrize("name", ["_satellites", "_asteroids", "_scores"])
def test_no_code_of_the_package(name):
    tree = ast.parse((ROOT / "benchmarks" / f"{name}.py").read_text())
    result = {a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names}
    result |= {str(n.module) for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)}
    allowed = ("__future__", "numpy", "scipy", "dataclasses", "itertools", "pathlib", "typing")
    assert all(name.startswith((*allowed, "collections")) for name in result)


def directions(phase: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    sun = np.tile([1.0, 0.0, 0.0], (phase.size, 1))
    return sun, np.stack([np.cos(phase), 0 * phase, np.sin(phase)], axis=1)


# ------------------------------------------------------------------------ brightness


def test_a_plate_is_the_product_of_the_cosines():
    sun, obs = directions(np.radians([0.0, 30.0, 80.0]))
    for tilt in (0.0, 0.4, 1.2):
        normal = np.array([np.cos(tilt), 0.0, np.sin(tilt)])
        normals = np.tile(normal, (3, 1, 1))
        result = satellites.facet_flux(normals, np.array([2.0]), sun, obs, 0.0)[:, 0]
        view = np.cos(np.radians([0.0, 30.0, 80.0]) - tilt)
        np.testing.assert_allclose(result, 2.0 * np.cos(tilt) * np.maximum(view, 0) / np.pi)
    behind = np.tile([-1.0, 0.0, 0.0], (3, 1, 1))
    assert not satellites.facet_flux(behind, np.array([2.0]), sun, obs, 0.0).any()


def sphere_law(phase: np.ndarray) -> np.ndarray:
    """∫ μ₀ μ dΩ over the lit and visible part of the unit sphere (Lambert's phase law)."""
    return 2.0 / 3.0 * (np.sin(phase) + (np.pi - phase) * np.cos(phase))


def test_a_sphere_has_lamberts_phase_law():
    sun, obs = directions(PHASES)
    normals = asteroids.patches(20_000)
    areas = np.full(len(normals), 4.0 * np.pi / len(normals))
    whole = np.broadcast_to(normals, (PHASES.size, *normals.shape))
    result = satellites.facet_flux(whole, areas, sun, obs, 0.0).sum(axis=1)
    np.testing.assert_allclose(result, sphere_law(PHASES) / np.pi, rtol=2e-3)
    ball = asteroids.ellipsoid(np.ones(3), 20_000)
    lambert = asteroids.flux(ball, sun, obs, 1.0) - asteroids.flux(ball, sun, obs, 0.0)
    np.testing.assert_allclose(lambert, sphere_law(PHASES), rtol=2e-3)


def test_lommel_and_seeligers_sphere():
    """∫ μ₀μ/(μ₀ + μ) dΩ = π [1 − sin(α/2) tan(α/2) ln cot(α/4)]/2."""
    half = PHASES[1:] / 2
    want = np.pi / 2 * (1 - np.sin(half) * np.tan(half) * np.log(1 / np.tan(half / 2)))
    sun, obs = directions(PHASES[1:])
    result = asteroids.flux(asteroids.ellipsoid(np.ones(3), 20_000), sun, obs, 0.0)
    np.testing.assert_allclose(result, want, rtol=3e-3)


def test_a_lobe_reflects_towards_the_mirror_direction():
    """At the mirror direction, (1 − s)/π + s (n + 2)/2π; far from it, only the diffuse part."""
    sun = np.array([[np.sin(0.5), 0.0, np.cos(0.5)]] * 2)
    obs = np.array([[-np.sin(0.5), 0.0, np.cos(0.5)], [np.sin(0.9), 0.0, np.cos(0.9)]])
    up = np.tile([0.0, 0.0, 1.0], (2, 1, 1))
    result = satellites.facet_flux(up, np.array([1.0]), sun, obs, 0.1)[:, 0]
    cosines = np.cos(0.5) * np.array([np.cos(0.5), np.cos(0.9)])
    lobe = 0.1 * 52.0 / (2 * np.pi)
    np.testing.assert_allclose(result[0] / cosines[0], 0.9 / np.pi + lobe)
    np.testing.assert_allclose(result[1] / cosines[1], 0.9 / np.pi, rtol=1e-3)


def test_magnitudes_of_a_square_metre_at_a_known_distance():
    """f = 1 m² at 1000 km and 1 au: m☉ + 30; at 2 au, 1.505 mag fainter."""
    result = satellites.magnitudes(np.ones(2), np.full(2, 1000.0), np.array([1.0, 2.0]))
    np.testing.assert_allclose(result, [3.24, 3.24 + 5 * np.log10(2.0)])


# ----------------------------------------------------------------- asteroid bodies


def projected(surface: asteroids.Surface, toward: np.ndarray) -> float:
    """Visible area, with shadows, seen from a direction."""
    mu = np.maximum(surface.normals @ toward, 0.0)
    return float(np.sum(surface.areas * mu * asteroids.free(surface, toward)))


def test_projected_areas():
    axes = np.array([1.0, 0.8, 0.5])
    body = asteroids.ellipsoid(axes, 20_000)
    box = asteroids.brick(2 * axes)
    for k, (i, j) in enumerate(((1, 2), (0, 2), (0, 1))):
        toward = np.eye(3)[k]
        assert projected(body, toward) == pytest.approx(np.pi * axes[i] * axes[j], rel=1e-3)
        assert projected(box, toward) == pytest.approx(4 * axes[i] * axes[j])
    # an ellipsoid along any direction: π √Σ (product of the other axes × cosine)²
    d = np.array([0.48, 0.6, 0.64])
    others = np.prod(axes) / axes
    assert projected(body, d) == pytest.approx(np.pi * np.linalg.norm(others * d), rel=1e-3)


def test_one_sphere_hides_the_other():
    """End-on only the nearer sphere is seen, from the side both; the overlap is left out."""
    apart = asteroids.binary((1.0, 0.7), 2.5, 20_000)
    ends = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    result = [projected(apart, d) for d in ends]
    np.testing.assert_allclose(result[0], np.pi * 1.0, rtol=0.01)  # the smaller disc is inside
    np.testing.assert_allclose(result[1], np.pi * 1.0, rtol=0.01)
    np.testing.assert_allclose(result[2], np.pi * (1.0 + 0.49), rtol=0.01)
    touching = asteroids.binary((1.0, 1.0), 1.0, 20_000)
    caps = 2 * np.pi * 1.0 * 0.5  # area of the cap of one sphere inside the other
    assert touching.areas.sum() == pytest.approx(2 * (4 * np.pi - caps), rel=0.01)
    lens = 2 * np.arccos(0.5) - 0.5 * np.sqrt(3.0)
    assert projected(touching, ends[2]) == pytest.approx(2 * np.pi - lens, rel=0.01)


def test_a_shadow_darkens_what_is_seen():
    """Sun end-on and observer from the side: the farther of two equal spheres is in shadow."""
    pair = asteroids.binary((1.0, 1.0), 3.0, 4_000)
    sun, obs = np.array([[-1.0, 0.0, 0.0]]), np.array([[0.0, 1.0, 0.0]])
    one = asteroids.flux(asteroids.ellipsoid(np.ones(3), 4_000), sun, obs)
    np.testing.assert_allclose(asteroids.flux(pair, sun, obs), one, rtol=1e-9)


def test_a_spot_covers_its_cap():
    ball = asteroids.with_spot(
        asteroids.ellipsoid(np.ones(3), 20_000), np.array([0, 2.0, 0]), 0.5, 0.3
    )
    dark = ball.areas[ball.albedo == 0.3].sum()
    assert dark == pytest.approx(2 * np.pi * (1 - np.cos(0.5)), rel=0.01)


def test_turning_about_the_pole():
    """The pole stays at z, and the body's turn by φ is that of the sky by −φ."""
    pole = asteroids.unit(np.array([0.3, -0.5, 0.6]))
    angle = np.array([0.0, 0.7, 2.0])
    np.testing.assert_allclose(
        asteroids.to_body(np.tile(pole, (3, 1)), pole, angle), [[0, 0, 1.0]] * 3, atol=1e-15
    )
    v = np.tile(asteroids.unit(np.array([1.0, 0.2, -0.4])), (3, 1))
    result = asteroids.to_body(v, pole, angle)
    want = Rotation.from_rotvec(np.outer(-angle, [0, 0, 1.0])).apply(result[0])
    np.testing.assert_allclose(result, want, atol=1e-14)


def test_damit_files(tmp_path):
    import lcbayes

    case = asteroids.draw_case("brick", 1)
    asteroids.write(case, tmp_path / "brick.lcs")
    curve = lcbayes.read(tmp_path / "brick.lcs")
    assert curve.n_obs == asteroids.N_CURVES * asteroids.N_POINTS
    assert curve.free_scale.all()
    np.testing.assert_allclose(curve.sun, asteroids.unit(case.sun), atol=1e-9)
    assert case.t[-1] - case.t[0] > 300.0
    step = case.period_h**2 / (2 * 24.0 * np.ptp(case.t))
    assert abs(case.given_period_h - case.period_h) <= step / 3


# ------------------------------------------------------------------ satellites, motion


def test_sun_and_sidereal_time():
    """Equinox of 2024 March 20, 03:06 UT; perihelion of 2024 January 3; Meeus, example 12.a."""
    vector, _ = satellites.sun_vector(np.array([2460389.6292]))
    np.testing.assert_allclose(vector[0], [1.0, 0.0, 0.0], atol=5e-4)
    assert satellites.sun_vector(np.array([2460312.53]))[1][0] == pytest.approx(0.98331, abs=1e-4)
    gmst = np.degrees(satellites.sidereal(np.array([2446895.5]))) % 360
    assert gmst[0] == pytest.approx(197.693195, abs=1e-4)


def rotations(fault: Fault, t: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """Matrices R(t) (T, 3, 3) of the motion."""
    body = Body(np.eye(3), np.ones(3), omega)
    columns = satellites.normals_at(body, t, fault, t[0], t[-1])
    return np.swapaxes(columns, 1, 2)


def test_constant_rate():
    omega, t = np.array([0.02, -0.05, 0.03]), np.linspace(0.0, 400.0, 50)
    want = Rotation.from_rotvec(t[:, None] * omega).as_matrix()
    np.testing.assert_allclose(rotations(Fault(), t, omega), want, atol=1e-12)


def angular_velocity(matrices: np.ndarray, t: np.ndarray) -> np.ndarray:
    step = Rotation.from_matrix(matrices[2:] @ np.swapaxes(matrices[:-2], 1, 2))
    return step.as_rotvec() / (t[2:] - t[:-2])[:, None]


def test_drift_changes_the_rate_linearly_about_its_mean():
    omega, t = np.array([0.0, 0.04, 0.03]), np.linspace(0.0, 1000.0, 2001)
    rate = np.linalg.norm(angular_velocity(rotations(Fault(rate_drift=0.03), t, omega), t), axis=1)
    want = 0.05 * (1 + 0.03 * (t[1:-1] - 500.0) / 1000.0)
    np.testing.assert_allclose(rate, want, rtol=1e-6)


def test_nutation_is_torque_free():
    """The angular momentum I ω is constant, along the mean axis, and 2° from the body's axis."""
    omega, t = np.array([0.01, -0.04, 0.03]), np.linspace(0.0, 300.0, 3001)
    matrices = rotations(Fault(nutation=2.0), t, omega)
    axis = omega / np.linalg.norm(omega)
    rate = angular_velocity(matrices, t)
    inertia = np.eye(3) + (satellites.INERTIA_RATIO - 1.0) * np.outer(axis, axis)
    turned = matrices[1:-1]
    momentum = np.einsum("tij,jk,tlk,tl->ti", turned, inertia, turned, rate)
    np.testing.assert_allclose(momentum - momentum[0], 0.0, atol=1e-6)
    np.testing.assert_allclose(np.cross(momentum[0], axis), 0.0, atol=1e-6)
    tilt = np.degrees(np.arccos(turned @ axis @ axis))
    np.testing.assert_allclose(tilt, 2.0, rtol=1e-9)
    # the mean motion is the constant rate: the two never part by more than the angles allow
    off = Rotation.from_matrix(matrices @ np.swapaxes(rotations(Fault(), t, omega), 1, 2))
    assert np.degrees(off.magnitude()).max() < 4.1


# ------------------------------------------------------------------- satellites, faults


@pytest.fixture(scope="module")
def plain() -> satellites.Case:
    return satellites.draw_case(Fault(clock=1e-9), 4)  # with two sites or more


def test_campaigns_are_what_they_say(plain):
    campaign = plain.campaign
    assert campaign.n_sites >= 2
    assert len(plain.magnitude) == satellites.N_POINTS
    assert len(np.unique(campaign.which_pass)) == campaign.n_passes
    assert np.all(campaign.orbit.visible(campaign.t, campaign.site))
    gaps = np.diff(np.sort(campaign.t))
    assert np.sum(gaps > 0.3 * satellites.DAY) == campaign.n_nights - 1


def test_a_zero_point_shifts_the_second_site_alone(plain):
    other = satellites.draw_case(Fault(zero_point=0.03), 4)
    shift = other.magnitude - plain.magnitude
    np.testing.assert_allclose(shift, 0.03 * (plain.campaign.site == 1), atol=1e-9)


def test_a_clock_shifts_recorded_times_alone(plain):
    other = satellites.draw_case(Fault(clock=0.5), 4)
    a, b = np.argsort(plain.campaign.t), np.argsort(other.campaign.t)
    late = other.recorded[b] - plain.recorded[a]
    np.testing.assert_allclose(late, 0.5 * (plain.campaign.site[a] == 1), atol=1e-8)
    np.testing.assert_allclose(other.magnitude[b], plain.magnitude[a], atol=1e-6)
    assert np.all(np.diff(other.recorded) > 0)


@pytest.mark.parametrize("fault", [Fault(lobe=0.06), Fault(extra_facet=0.08), Fault(nutation=2.0)])
def test_other_faults_change_the_brightness_by_per_cents(fault):
    """Of the same body at the times that are in both: each is seen where it is bright."""
    base, other = satellites.draw_case(Fault(), 1), satellites.draw_case(fault, 1)
    _, a, b = np.intersect1d(base.recorded, other.recorded, return_indices=True)
    assert len(a) > 50
    np.testing.assert_allclose(base.areas, other.areas)
    change = np.sqrt(np.mean((base.magnitude[a] - other.magnitude[b]) ** 2))
    assert 0.001 < change < 0.5


def test_a_body_with_a_drift_is_seen_where_it_is_bright():
    """Its facets, turned at a rate that changes about the mean given as truth, explain the points
    for the right drift; without one they are dark at many."""
    case = satellites.draw_case(Fault(rate_drift=0.01), 12)
    body = Body(case.normals, case.areas, case.omega)
    t = case.recorded - case.recorded.min()
    sun, obs, distance = case.campaign.orbit.view(case.campaign.t, case.campaign.site)
    au = satellites.sun_vector(case.campaign.orbit.jd + case.campaign.t / satellites.DAY)[1]

    def chi2(drift: float) -> float:
        turned = satellites.normals_at(body, t, Fault(rate_drift=drift), 0.0, t.max())
        flux = satellites.facet_flux(turned, case.areas, sun, obs, 0.0).sum(axis=1)
        model = satellites.magnitudes(np.maximum(flux, 1e-6), distance, au)
        return float(np.sum(((case.magnitude - model) / case.error) ** 2))

    assert min(chi2(d) for d in np.linspace(0.009, 0.0101, 45)) < 230.0  # 160 points
    assert chi2(0.0) > 10_000.0


def test_correlated_noise_has_its_correlation():
    """Autocovariance exp(−Δt/τ) of a process of unit variance, also for unsorted times."""
    rng = np.random.default_rng(1)
    t = np.linspace(0.0, 299_995.0, 60_000)
    z = satellites.correlated(rng, t, 20.0)
    assert np.mean(z**2) == pytest.approx(1.0, abs=0.05)
    assert np.mean(z[4:] * z[:-4]) == pytest.approx(np.exp(-1.0), abs=0.05)
    shuffled = rng.permutation(t.size)
    again = satellites.correlated(rng, t[shuffled], 20.0)
    sorted_again = again[np.argsort(shuffled)]
    assert np.mean(sorted_again[4:] * sorted_again[:-4]) == pytest.approx(np.exp(-1.0), abs=0.05)


def test_the_packages_model_explains_a_file_without_faults(tmp_path):
    """Two implementations of geometry, motion, brightness and magnitudes: χ² of 160 points is
    160 ± 18 at the truth, and larger by 30 or more if the body is turned by 3°.
    """
    import lcbayes
    from lcbayes.core.jax_setup import jnp
    from lcbayes.modelling import nuisances, registry
    from lcbayes.modelling.epochs import Epochs
    from lcbayes.modelling.problem import Problem

    case = satellites.draw_case(Fault(), 1)
    satellites.write(case, tmp_path / "curve.csv")
    data = Epochs.of(lcbayes.read(tmp_path / "curve.csv"))
    options = {"n_facets": 3, "reflectance": "lambertian"} | nuisances.UNMODELLED
    problem = Problem(registry.find("faceted").bind(options), data)

    def chi2(normals: np.ndarray) -> float:
        sites = {
            "normals_base": jnp.asarray(normals),
            "log_albedo_area": jnp.log(jnp.asarray(case.areas)),
            "omega_unit": jnp.asarray(case.omega) / 0.1,
        }
        mean = problem.moments(problem.ravel(sites), data).mean
        return float(np.sum(((data.brightness - mean) / data.error) ** 2))

    assert chi2(case.normals) == pytest.approx(160.0, abs=60.0)
    turned = Rotation.from_rotvec(np.radians([0.0, 0.0, 3.0])).apply(case.normals)
    assert chi2(turned) > chi2(case.normals) + 30.0


def test_faults_between_sites_need_two():
    assert Fault().needs_sites == Fault(lobe=0.1).needs_sites == 1
    assert Fault(clock=0.1).needs_sites == Fault(zero_point=0.1).needs_sites == 2
