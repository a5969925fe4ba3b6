"""The search for the motion of a known body, against an independent simulator."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.progress import Silent
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inference.body_search import cells, phases, turns
from lcbayes.inference.body_search import surface as surface_of_body
from lcbayes.inference.body_search.surface import Surface, solved
from lcbayes.inference.problem_cache import build_problem
from lcbayes.inference.spin_search.allowed import Allowed
from lcbayes.inference.spin_search.arcs import Arcs
from lcbayes.inference.spin_search.drift import Drift
from lcbayes.modelling import registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import compiled
from lcbayes.models import body as model
from lcbayes.simulation.known_bodies.reader import body_text, read_body_text
from tests.helpers import small_curves
from tests.helpers import turning_bodies as turning

SIDES, ALBEDO = (1.0, 2.0, 3.0), 0.4
BOX = """
[body]
[[body.parts]]
kind = "box"
x = 1.0
y = 2.0
z = 3.0
[materials.paint]
law = "lambertian"
r_diff = { low = 0.1, high = 0.9 }
"""
CYLINDER = BOX.replace(
    'kind = "box"\nx = 1.0\ny = 2.0\nz', 'kind = "cylinder"\nradius = 0.7\nlength'
)
ATTITUDE = Rotation.from_rotvec([0.7, -1.1, 0.4]).as_matrix()
KNOWN = read_body_text(BOX).body
OMEGA = 0.07 * ATTITUDE @ KNOWN.flat_axis
ALL = Allowed(((0.0, 0.1),), omega_sd=0.025)  # rad/s


def seen(
    starts: tuple[float, ...],
    omega: np.ndarray = OMEGA,
    snr: float = 30.0,
    n: int = 40,
    drift: float = 0.0,
) -> LightCurve:
    """The box on passes of 200 s with n points; the rate changes by ``drift`` of itself."""
    t, sun, obs = turning.geometry(starts, n, 200.0)
    length = np.ptp(t)
    even = t + drift * ((t - length / 2.0) ** 2 - (length / 2.0) ** 2) / (2.0 * length)
    flux = turning.box(*turning.in_body(even, ATTITUDE, omega, sun, obs), SIDES, ALBEDO)
    error = flux.mean() / snr
    noisy = flux + error * np.random.default_rng(3).standard_normal(t.size)
    return small_curves.of_flux(t, noisy, error, sun, obs)


def search_of(light: LightCurve, body: str = BOX, allowed: Allowed = ALL) -> cells.MotionSearch:
    file, data = read_body_text(body), Epochs.of(light)
    axis = file.body.flat_axis[None]
    return cells.MotionSearch.of(data, Surface.of(file, data.sun, data.obs), axis, allowed)


def apart(a: np.ndarray, b: np.ndarray) -> float:
    """Smallest angle (deg) between two attitudes of the box."""
    every = [Rotation.from_matrix(a @ (b @ g).T).magnitude() for g in KNOWN.symmetry.rotations]
    return float(np.degrees(min(every)))


def test_a_dense_light_curve_is_searched():
    """Its points are averaged, and so are the directions to an observer who passes quickly."""
    run = search_of(seen((0.0, 2000.0), n=300))
    assert run.arcs.dt.shape[1] < 100
    data = phases.Separate.of(run, 1.0).soft
    for vectors in (data.sun, data.obs):
        np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), 1.0, rtol=1e-12)


def test_the_flux_is_linear_in_the_reflectances(monkeypatch):
    """The columns of a body of three materials give its flux for any of them."""
    monkeypatch.setattr(surface_of_body, "LEAST", 0.0)
    text = body_text("box-wing").replace("ashikhmin-shirley", "blinn-phong").replace("nu =", "n =")
    text = text.replace("high = 0.7", "high = 0.5")
    file = read_body_text(text)
    rng = np.random.default_rng(1)
    sun, obs = (v / np.linalg.norm(v, axis=1)[:, None] for v in rng.standard_normal((2, 200, 3)))
    surface = Surface.of(file, jnp.asarray(sun), jnp.asarray(obs))
    assert surface.size == 6
    x = np.array([1.7, *(1.7 * rng.uniform(-0.5, 0.5, 5))])
    values = surface.values(x)
    flux = 1.7 * np.asarray(file.body.flux(jnp.asarray(sun), jnp.asarray(obs), values, False))
    linear = np.asarray(surface.columns(jnp.asarray(sun), jnp.asarray(obs))) @ x
    np.testing.assert_allclose(linear, flux, atol=1e-9 * flux.max())
    sites = surface.sites(values)
    assert set(sites) == {"bus_r_diff", "bus_r_spec", "panel_r_diff", "panel_r_spec", "back_r_diff"}


def test_small_systems_are_solved():
    rng = np.random.default_rng(2)
    root = rng.standard_normal((50, 5, 5))
    square, cross = root @ root.transpose(0, 2, 1), rng.standard_normal((50, 5))
    rows = [[jnp.asarray(square[:, i, j]) for j in range(5)] for i in range(5)]
    x = np.stack(solved(rows, [jnp.asarray(cross[:, i]) for i in range(5)]), axis=1)
    np.testing.assert_allclose(x, np.linalg.solve(square, cross[..., None])[..., 0], rtol=1e-6)


def test_all_cells_of_a_flat_spin_are_visited(monkeypatch):
    """A start is next to the motion that the light curve was made from, in each pass."""
    monkeypatch.setattr(cells, "POLES", 160)
    monkeypatch.setattr(phases, "STARTS", 512)
    light = seen((0.0, 40_000.0))
    run = search_of(light)
    result, coverage = run.run(1, Silent())
    pole = OMEGA / np.linalg.norm(OMEGA)
    rows = run.distinct(result, 8)
    near = (np.abs(result.pole[rows] @ pole) > np.cos(np.radians(15.0))) & (
        np.abs(result.rate[rows] - 0.07) < run.step
    )
    assert near.any()
    assert coverage.max_rate == pytest.approx(0.1)
    off = []
    for start in phases.starts(run, result):
        each = [
            apart(
                Rotation.from_rotvec(late * start.omega).as_matrix() @ start.attitude,
                Rotation.from_rotvec(middle * OMEGA).as_matrix() @ ATTITUDE,
            )
            for late, middle in zip(start.late, np.asarray(run.arcs.middle), strict=True)
        ]
        off.append(max(each))
    assert min(off) < 25.0


def test_only_the_rates_of_known_periods_are_visited(monkeypatch):
    """The same best motions as without them, from fewer cells, and none outside."""
    monkeypatch.setattr(cells, "POLES", 160)
    light = seen((0.0, 900.0))
    low, high = 0.0688, 0.0712
    run, some = search_of(light), search_of(light, allowed=Allowed(((low, high),)))
    (every, all_cells), (result, coverage) = run.run(1, Silent()), some.run(1, Silent())
    assert np.all((result.rate >= low) & (result.rate <= high))
    inside = np.abs(every.rate - 0.07) < 0.5 / 200.0
    best, most = result.gain[0], every.gain[inside].max()
    share = best / float(jnp.sum(some.arcs.white**2))
    assert share == pytest.approx(most / float(jnp.sum(run.arcs.white**2)), abs=0.01)
    assert coverage.ranges == ((low, high),)
    assert 0 < coverage.cells < 0.1 * all_cells.cells


def test_optima_outside_the_known_periods_are_moved_to_them():
    """The search for phases may leave the rates that are allowed."""
    light, low, high = seen((0.0, 900.0)), 0.05, 0.051
    data, run = Epochs.of(light), search_of(light)
    separate = phases.Separate.of(run, 1.0)
    entry = registry.find("body")
    options = entry.check(
        {"body": BOX} | model.POOLED | model.SEARCHED | {"clock_sd": separate.clock_sd}
    )
    problem, _ = build_problem(entry, options, separate.soft)
    sites = {
        "attitude_base": Rotation.from_matrix(ATTITUDE).as_quat(scalar_first=True),
        "rate_unit": 0.7,
    } | separate.offsets(np.zeros(2))
    z = np.asarray(phases.rows(problem, separate.exact, [sites])[0])
    drift = Drift(float(data.t_middle), float(data.t_span), 0.01)
    found = list(turns.joined(problem, separate, z, Allowed(((low, high),)), drift))
    assert found
    rates = np.array([one["rate_unit"] * 0.1 for one in found])
    assert np.all((rates >= low - 1e-12) & (rates <= high + 1e-12))


@pytest.mark.parametrize(
    ("allowed", "drift"), [(ALL, 0.0), (ALL, 0.004), (Allowed(((0.0699, 0.0701),)), 0.0)]
)
def test_the_phases_of_passes_give_the_rates_that_join_them(allowed, drift):
    """The true rate is among them, and all others differ by half turns and are allowed.

    The drift moves the phase of the second pass by 58 degrees.
    """
    light = seen((0.0, 9_000.0, 40_000.0), drift=drift)
    data = Epochs.of(light)
    run = search_of(light)
    separate = phases.Separate.of(run, 1.0)
    entry = registry.find("body")
    options = entry.check(
        {"body": BOX} | model.POOLED | model.SEARCHED | {"clock_sd": separate.clock_sd}
    )
    problem, _ = build_problem(entry, options, separate.soft)
    middle = separate.middle
    length = np.ptp(light.t)
    even = middle + drift * ((middle - length / 2.0) ** 2 - (length / 2.0) ** 2) / (2.0 * length)
    late = ((0.07 * (even - even[0]) + np.pi) % (2.0 * np.pi) - np.pi) / 0.07
    first = Rotation.from_rotvec(even[0] * OMEGA).as_matrix() @ ATTITUDE
    sites = {
        "attitude_base": Rotation.from_matrix(first).as_quat(scalar_first=True),
        "rate_unit": 0.7,
        "paint_r_diff": ALBEDO,
        "log_brightness": np.log(KNOWN.areas["paint"] * ALBEDO),
    } | separate.offsets(late)
    z = phases.rows(problem, separate.exact, [sites])[0]
    missed = separate.exact.brightness - compiled(problem.constrain)(z, separate.exact)["expected"]
    assert np.mean(np.asarray(missed / separate.exact.error) ** 2) == pytest.approx(1.0, abs=0.3)
    rates, drifts, attitudes = [], [], []
    full, _ = build_problem(entry, options | {"clock_sd": 0.0, "rate_drift_sd": 0.01}, data)
    possible = Drift(float(data.t_middle), float(data.t_span), 0.01)
    for one in turns.joined(problem, separate, np.asarray(z), allowed, possible):
        row = phases.rows(full, data, [one])[0]
        found = compiled(full.constrain)(row, data)
        rates.append(float(np.linalg.norm(found["omega"])))
        drifts.append(float(found["rate_drift"]))
        attitudes.append(np.asarray(found["attitude"]))
    assert allowed.rates(np.array(rates)).all()
    off = np.abs(np.array(rates) - 0.07) + np.abs(np.array(drifts) - drift) * 0.07 / 8.0
    best = int(np.argmin(off))
    assert abs(rates[best] - 0.07) * length < 0.5
    assert abs(drifts[best] - drift) * 0.07 * length / 8.0 < 0.3
    assert apart(attitudes[best], ATTITUDE) < 15.0
    assert len(rates) > 1


@pytest.mark.parametrize("third", [0.0, 1e-18, 1e9])
def test_a_coordinate_without_information_leaves_the_rate_and_the_phases(third):
    """Such as a reflectance at the end of its range, at an optimum of the search."""

    class Optimum:
        def constrain(self, z, data):  # noqa: ARG002
            late = jnp.stack([jnp.zeros(()), z[1], 2.0 * z[1]])
            return {"omega": jnp.stack([z[0], 0.0 * z[0], 0.0 * z[0]]), "clock_offset": late}

        def fisher(self, z, data):  # noqa: ARG002
            return jnp.diag(jnp.array([1e6, 4.0, third]))

    rate, late = 0.2, 3.0
    slopes = np.array([[1.0, 0.0], [late, rate], [2.0 * late, 2.0 * rate]])
    expected = slopes @ np.diag([1e-6, 0.25]) @ slopes.T
    found = turns._covariance(Optimum(), None, jnp.array([rate, late, 1800.0]))
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_a_motion_of_many_turns_between_passes_is_found(monkeypatch):
    """446 turns lie between two passes; the search ends at the true motion, among its equals."""
    monkeypatch.setattr(cells, "POLES", 160)
    monkeypatch.setattr(phases, "STARTS", 256)
    light = seen((0.0, 40_000.0), snr=200.0)
    data, entry = Epochs.of(light), registry.find("body")
    defaults = {o.name: o.default for o in entry.options.values()}
    options = entry.check(defaults | {"body": BOX, "omega_sd": 0.025} | model.POOLED)
    problem, _ = build_problem(entry, options, data)
    ends, _ = model.search(problem, data, options, 1, Silent())
    known = []
    for z, potential in zip(ends.z, np.asarray(ends.potential), strict=True):
        found = compiled(problem.constrain)(z, data)
        missed = np.asarray((data.brightness - found["expected"]) / data.error)
        if potential < ends.potential[0] + 5.0:
            assert np.mean(missed**2) < 1.3
            known.append((np.linalg.norm(found["omega"]), apart(found["attitude"], ATTITUDE)))
    rates, angles = np.array(known).T
    # Half a turn changes nothing, so that rates that differ by half a turn fit as well.
    turns_apart = (rates - 0.07) * 40_000.0 / np.pi
    assert np.abs(turns_apart - np.round(turns_apart)).max() < 0.1
    assert np.any((np.abs(turns_apart) < 0.1) & (angles < 5.0))


def test_a_motion_is_found_although_a_pass_is_late(monkeypatch):
    """A drift of the rate explains the middle one of three passes if it is 4 s (16 deg) late.

    The search has the drift if the option is given, or again if nothing else explains the data.
    """
    monkeypatch.setattr(cells, "POLES", 160)
    monkeypatch.setattr(phases, "STARTS", 256)
    light = seen((0.0, 9_000.0, 40_000.0), snr=200.0)
    t = light.t + 4.0 * ((light.t > 5_000.0) & (light.t < 20_000.0))
    data, entry = Epochs.of(replace(light, t=t)), registry.find("body")
    defaults = {o.name: o.default for o in entry.options.values()}
    given = {"body": BOX, "omega_sd": 0.025}
    assert entry.searched(given)["rate_drift_sd"] == 0.0
    assert "rate_drift_sd" not in entry.searched(given, faulty=True)
    options = entry.check(defaults | entry.searched(given | {"rate_drift_sd": 0.01}))
    problem, _ = build_problem(entry, options, data)
    ends, _ = model.search(problem, data, options, 1, Silent())
    found = compiled(problem.constrain)(ends.z[0], data)
    missed = np.asarray((data.brightness - found["expected"]) / data.error)
    assert np.mean(missed**2) < 1.3


def test_no_cell_gains_more_than_all_of_the_light():
    """No gain exceeds χ² of a dark body, where a glint comes and goes, and a plate is edge-on."""
    body = body_text("box-wing").replace("median = 60.0", "median = 2000.0")
    known = read_body_text(body).body
    t, sun, obs = turning.geometry((0.0, 900.0), 30, 200.0)
    omega = 0.07 * ATTITUDE @ known.flat_axis
    inside = turning.in_body(t, ATTITUDE, omega, sun, obs)
    flux = np.asarray(jax.jit(lambda s, o: known.flux(s, o, shadows=False))(*inside))
    light = small_curves.of_flux(t, flux, flux.mean() / 100.0, sun, obs)
    run = search_of(light, body)
    total = float(jnp.sum(run.arcs.white**2))
    waves = run.waves(run.rates)
    for part in np.split(cells.facets.grid(64), 4):
        assert np.all(run.chunk(0, part, waves).gain < total)


def test_errors_are_reduced_where_wrong_motions_fit():
    """A light curve that is nearly constant is not searched with errors of 30 %."""
    run = search_of(seen((0.0, 900.0)))
    total = float(jnp.sum(run.arcs.white**2))
    assert run.sharper(total - 0.5 * run.arcs.white.size) is None
    sharper = run.sharper(total - 0.04 * run.arcs.white.size)
    assert sharper is not None
    ratio = np.asarray(sharper.arcs.weight / run.arcs.weight)
    assert np.all((ratio > 2.0) & (ratio < 5.0))  # five times but for the errors of the data


def test_directions_of_a_symmetric_body_are_visited_once():
    cylinder = read_body_text(CYLINDER).body
    some = cells.directions_of(None, None, KNOWN.symmetry.rotations)
    assert 0.2 * cells.AXES < len(some) < 0.32 * cells.AXES
    cone = cells.directions_of(None, cylinder.symmetry.axis, cylinder.symmetry.rotations)
    assert len(cone) == 12  # from the axis to across it, as both ends are alike


@pytest.mark.parametrize("tolerance", [0.02, 0.01, 0.005, 1e-3])
def test_the_axis_of_a_flat_spin_does_not_depend_on_the_tolerance(tolerance):
    """Two moments of a rocket stage are equal, and the order of rounded ones must not matter."""
    text = body_text("rocket-stage")
    axis = read_body_text(text, tolerance).body.flat_axis
    np.testing.assert_allclose(axis, read_body_text(text).body.flat_axis, atol=1e-12)


@pytest.mark.parametrize(("count", "kept"), [(1, 240), (3, 128), (8, 96)])
def test_points_of_the_search_are_shared_among_the_arcs(count, kept):
    """A single arc keeps its points, so that glints are not missed."""
    shape = (count, 240)
    vectors = jnp.zeros((*shape, 3))
    ones = jnp.ones(shape)
    dt = jnp.tile(jnp.linspace(-150.0, 150.0, 240), (count, 1))
    arcs = Arcs(jnp.arange(count) * 1e3, jnp.ones(count), dt, vectors, vectors, ones, ones)
    assert cells.thinned(arcs).dt.shape == (count, kept)
