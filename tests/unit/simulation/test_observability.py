"""Information of measurements and of campaigns, what they leave open, and the words for it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from lcbayes.cli.task import wrapped
from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.physics.attitude.laws import Ephemeris
from lcbayes.simulation.observability import campaign_plan, planning, summary
from lcbayes.simulation.observability.campaign import (
    Campaign,
    bound,
    campaign,
    flux_weight,
    jacobian,
)
from lcbayes.simulation.observability.linearity import MAX_NONLINEARITY, nonlinearity
from lcbayes.simulation.observability.measurements import measure, over_directions
from lcbayes.simulation.observability.parameters import GROUPS, USUAL, Unknowns
from lcbayes.simulation.observability.targets import of_unknowns
from lcbayes.simulation.observability.trades import Trade, trades, varimax
from lcbayes.simulation.scenarios import scenario
from lcbayes.simulation.scenarios.epochs import epochs
from lcbayes.simulation.scenarios.scenario import ConstantRate, Noise, PrincipalAxis
from lcbayes.simulation.scenarios.viewing import Planar
from lcbayes.simulation.simulate import flux_at

PANEL = """
[[body.facets]]
normal = [0.2, 0.1, 1.0]
area_m2 = 2.0
material = "panel"
u = [1.0, 0.0, -0.2]
[[body.facets]]
normal = [1.0, 0.3, 0.4]
area_m2 = 1.5
material = "side"
[[body.facets]]
normal = [-1.0, 0.0, -1.0]
area_m2 = 1.0
material = "side"
[materials.panel]
law = "ashikhmin-shirley-distribution"
r_spec = 0.4
r_diff = 0.3
nu = 40.0
nv = 15.0
[materials.side]
law = "lambertian"
r_diff = 0.5
[attitude]
law = "constant-rate"
omega_rad_s = [0.002, -0.001, 0.003]
[geometry]
kind = "planar"
start = 0.0
stop = 120.0
step = 4.0
omega_obs = 0.008
lambda_obs = 0.1
omega_sun = 0.0
lambda_sun = 0.9
plane = "zx"
range_km = 800.0
[noise]
mag_err = 0.02
[output]
kind = "{kind}"
"""


@pytest.fixture(scope="module")
def panel(tmp_path_factory):
    """Anisotropic panel and two sides, one of them dark throughout, by output kind."""
    folder = tmp_path_factory.mktemp("scenarios")
    result = {}
    for kind in ("mag", "flux"):
        (folder / f"{kind}.toml").write_text(PANEL.replace("{kind}", kind))
        result[kind] = scenario.load(folder / f"{kind}.toml")
    return result


@pytest.fixture(scope="module")
def measured(panel):
    return {kind: measure(what) for kind, what in panel.items()}


@pytest.fixture(scope="module")
def everything(panel, measured):
    return campaign(Unknowns.of(panel["flux"], GROUPS), measured["flux"])


def test_gradients_are_those_of_a_body_that_is_turned(panel, measured):
    """Central differences of the magnitude with all facets turned by −δα, in numpy."""
    what, m = panel["mag"], measured["mag"]
    step = 1e-5
    for k in range(3):
        mags = []
        for sign in (1.0, -1.0):
            w = -sign * step * np.eye(3)[k]  # components of vectors turn by +δα, the body by −δα
            cross = np.cross(w, np.eye(3)).T  # [w×]
            turn = np.eye(3) + cross + 0.5 * cross @ cross
            body = what.body._replace(
                normals=what.body.normals @ turn.T, u_axes=what.body.u_axes @ turn.T
            )
            flux = flux_at(replace(what, body=body), m.curve.t, m.curve.sun, m.curve.obs)
            mags.append(-2.5 * np.log10(flux))
        slope = (mags[0] - mags[1]) / (2.0 * step)
        np.testing.assert_allclose(m.mag_gradient[:, k], slope, rtol=1e-5, atol=1e-6)


def test_magnitudes_and_fluxes_say_the_same(measured):
    """m and ∂m by either output; ∂f = −f ∂m/1.0857; the information is one number."""
    mag, flux = measured["mag"], measured["flux"]
    np.testing.assert_allclose(mag.mag, flux.mag, rtol=1e-12)
    np.testing.assert_allclose(mag.mag_gradient, flux.mag_gradient, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(mag.information, flux.information, rtol=1e-9)
    from_mag = -flux.clean[:, None] * mag.mag_gradient * np.log(10.0) / 2.5
    np.testing.assert_allclose(flux.flux_gradient, from_mag, rtol=1e-9)
    sd = np.asarray(flux.curve.error)
    np.testing.assert_allclose(
        np.sum(flux.flux_gradient**2, axis=1) / sd**2, mag.information, rtol=1e-9
    )
    gap = np.einsum("tij,tj->ti", mag.nullspace, mag.mag_gradient)
    size = np.linalg.norm(mag.mag_gradient, axis=1, keepdims=True)
    np.testing.assert_allclose(gap / size, 0.0, atol=1e-12)


def test_a_map_agrees_with_the_measurements(panel, measured):
    m = measured["flux"]
    flux, gradient = over_directions(panel["flux"], m.sun_body, m.obs_body)
    np.testing.assert_allclose(flux, m.flux, rtol=1e-12)
    np.testing.assert_allclose(gradient * m.unit[:, None], m.flux_gradient, rtol=1e-9)


def test_fisher_information_is_that_of_finite_differences(panel, measured, everything):
    """Every group at once: attitude, spin, normals with twist, areas, surface."""
    unknowns, m = everything.unknowns, measured["flux"]
    flux = jax.jit(unknowns.flux)
    assert {"omega_x", "normal_0_n", "panel.log_nv", "panel.r_spec"} <= set(unknowns.names)
    assert not any(name.startswith("side.") for name in unknowns.names)
    columns = []
    for k in range(len(unknowns.parameters)):
        step = 1e-6 if unknowns.parameters[k].group == "spin" else 1e-5
        e = np.eye(len(unknowns.parameters))[k] * step
        ends = [np.asarray(flux(s * e, m.curve.t, m.curve.sun, m.curve.obs)) for s in (1, -1)]
        columns.append((ends[0] - ends[1]) / (2.0 * step) * m.unit / np.asarray(m.curve.error))
    numeric = np.stack(columns, axis=1)
    size = np.abs(numeric).max(axis=0) + 1e-12
    np.testing.assert_allclose(everything.jacobian / size, numeric / size, atol=2e-6)
    # and of magnitudes, which are as well known here
    other = campaign(Unknowns.of(panel["mag"], ["attitude"]), measured["mag"])
    np.testing.assert_allclose(other.jacobian, everything.jacobian[:, :3], rtol=1e-9, atol=1e-9)


def test_one_exponent_of_an_isotropic_facet_moves_both(panel, measured):
    what, m = panel["flux"], measured["flux"]
    surface = what.materials["panel"]

    def with_nu(nu):
        made = replace(surface, parameters={**surface.parameters, "nu": nu, "nv": nu})
        return replace(what, materials={**what.materials, "panel": made})

    unknowns = Unknowns.of(with_nu(40.0), ["surface"])
    assert unknowns.names == ("panel.r_diff", "panel.r_spec", "panel.log_nu")
    some = [x[:3] for x in (m.curve.t, m.curve.sun, m.curve.obs)]
    moved = unknowns.flux(np.array([0.0, 0.0, np.log(1.5)]), *some)  # pyright: ignore[reportArgumentType]
    np.testing.assert_allclose(moved, flux_at(with_nu(60.0), *some), rtol=1e-12)


def test_what_nothing_depends_on_and_the_body_axes_are_named(panel, measured, everything):
    m, result = measured["flux"], everything
    left = trades(result, m)
    said = summary.sentences(left)
    assert any("facet 2 is never lit and seen" in line for line in said)
    axes = [t for t in left if "choice of body axes" in t.words]
    assert len(axes) == 3
    for t in left:
        assert t.exact == (np.abs(result.jacobian @ t.combination).max() < 1e-9)
    gaps = np.isinf(result.bound)
    assert gaps[result.unknowns.rows("attitude")].all()
    assert not gaps[result.unknowns.rows("spin")].any()
    assert np.isfinite(result.bound_with_prior).all()
    # without the attitude the axes are no longer free
    kept = np.setdiff1d(np.arange(len(gaps)), result.unknowns.rows("attitude"))
    alone = Campaign(Unknowns.of(panel["flux"], USUAL), result.jacobian[:, kept])
    assert not any("body axes" in t.words for t in trades(alone, m))


def test_area_and_tilt_trade_over_one_pass():
    """Linares & Crassidis, sec. VII.A: the exchange that a second pass ends, in its own words."""
    what = replace(scenario.load("one-facet"), noise=Noise("sigma", 2.0))
    assert isinstance(what.geometry, Planar)
    what = replace(what, geometry=replace(what.geometry, passes=what.geometry.passes[:1]))
    m = measure(what)
    said = summary.sentences(trades(campaign(Unknowns.of(what), m), m))
    assert len(said) == 1
    assert "rea and tilt of facet 0 trade across the pass direction" in said[0]


def test_facets_that_face_the_same_way_share_what_is_seen(panel, measured, everything):
    """The third facet's columns are a multiple of the second's, as they then are."""
    body = panel["flux"].body
    body = body._replace(normals=body.normals[[0, 1, 1]], u_axes=body.u_axes[[0, 1, 1]])
    unknowns = Unknowns.of(replace(panel["flux"], body=body), USUAL)
    j = everything.jacobian[:, 3:].copy()
    for name in ("normal_{}_u", "normal_{}_v", "log_albedo_area_{}"):
        here, there = (unknowns.names.index(name.format(i)) for i in (1, 2))
        j[:, there] = 0.4 * j[:, here]
    left = [t for t in trades(Campaign(unknowns, j), measured["flux"]) if t.exact]
    said = summary.sentences(left)
    assert len(left) == 3
    assert any("facets 1 and 2 face the same way, and how their area" in line for line in said)
    assert all("not seen at all" in line for line in said)


def test_bounds_are_those_of_the_inverse():
    rng = np.random.default_rng(1)
    j = rng.standard_normal((30, 4)) * [1.0, 1e-3, 1e3, 1.0]
    np.testing.assert_allclose(bound(j), np.sqrt(np.diag(np.linalg.inv(j.T @ j))), rtol=1e-9)
    j = np.column_stack([j[:, 0], j[:, 1], j[:, 1] * 2.0, np.zeros(30)])
    result = bound(j)
    assert result[0] == pytest.approx(np.linalg.inv(j[:, :2].T @ j[:, :2])[0, 0] ** 0.5, rel=1e-9)
    assert np.isinf(result[1:]).all()
    made = Campaign(Unknowns.of(scenario.load("one-facet")), rng.standard_normal((9, 3)))
    precision = made.fisher + np.diag(made.unknowns.prior_sd**-2.0)
    np.testing.assert_allclose(
        made.bound_with_prior, np.sqrt(np.diag(np.linalg.inv(precision))), rtol=1e-9
    )


def test_varimax_finds_sparse_columns_again():
    rng = np.random.default_rng(2)
    sparse = np.zeros((9, 3))
    sparse[[0, 1], 0], sparse[[3, 5, 6], 1], sparse[[7, 8], 2] = 0.5**0.5, 3.0**-0.5, 0.5**0.5
    mixed = sparse @ np.linalg.qr(rng.standard_normal((3, 3)))[0]
    result = varimax(mixed)
    overlap = np.abs(sparse.T @ result)
    np.testing.assert_allclose(np.sort(overlap.max(axis=0)), 1.0, atol=1e-6)


SPUN = """
[body]
shape = "cube"
material = "panel"
[materials.panel]
law = "ashikhmin-shirley"
r_spec = 0.4
r_diff = 0.3
nu = 50.0
nv = 50.0
[attitude]
law = "principal-axis"
pole_lon_deg = 30.0
pole_lat_deg = {lat}
period_s = 60.0
[geometry]
kind = "vectors"
file = "{lat}.csv"
[noise]
sigma = 0.1
"""


def spun(folder, lat):
    """One scene, turned as a whole to where its pole is at a latitude (deg)."""
    t = np.arange(0.0, 200.0, 5.0)
    azimuth, elevation = np.radians(20.0 + 0.3 * t), 0.4 * np.sin(t / 130.0)
    parts = [np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation)]
    obs = np.stack([*parts, np.sin(elevation)], axis=1)
    sun = np.tile([0.6, 0.0, 0.8], (len(t), 1))
    law = PrincipalAxis(30.0, 0.0, 60.0)
    first = Ephemeris(jnp.zeros(1), jnp.zeros((1, 3)))
    here, there = (replace(law, pole_lat_deg=b).frames(first).body[0] for b in (0.0, lat))
    turn = there @ here.T
    table = np.column_stack([t, sun @ turn.T, obs @ turn.T])
    head = "t,sun_x,sun_y,sun_z,obs_x,obs_y,obs_z"
    np.savetxt(folder / f"{lat}.csv", table, "%.16g", ",", header=head, comments="")
    (folder / f"{lat}.toml").write_text(SPUN.format(lat=lat))
    return scenario.load(folder / f"{lat}.toml")


def test_what_is_learnt_of_a_pole_does_not_depend_on_the_frame(tmp_path):
    """The scene turned as a whole, to 90° too: errors and bounds are the same."""
    result = []
    for lat in (0.0, 90.0):
        what = spun(tmp_path, lat)
        unknowns, curve = Unknowns.of(what, ("attitude", "spin")), epochs(what.geometry)
        c = Campaign(unknowns, jacobian(unknowns, curve.t, curve.sun, curve.obs) / 0.1)
        factor, target = campaign_plan.from_prior(c, "pole")
        sd = [
            planning.sd_after(factor[:, :, None], target.factor, np.arange(0, 40, step))
            for step in (40, 10, 1)
        ]
        result.append((c.bound_with_prior, c.bound, sd))
        assert np.sqrt(np.mean(np.sum(target.factor**2, axis=2))) == pytest.approx(
            np.degrees(3.0**-0.5)
        )
    for here, there in zip(*result, strict=True):
        np.testing.assert_allclose(here, there, rtol=1e-5)


def test_tilts_of_the_pole_are_its_longitude_and_latitude(tmp_path):
    """A finite tilt against the law at the pole it leads to, up to the phase that it keeps."""
    what = spun(tmp_path, 70.0)
    law, curve = what.attitude, epochs(what.geometry)
    assert isinstance(law, PrincipalAxis)
    unknowns = Unknowns.of(what, ["spin"])
    at = curve.t, curve.sun, curve.obs
    same = tuple(map(jnp.asarray, at))
    north = np.radians(2.0)
    moved = unknowns.flux(jnp.array([0.0, north, 0.0]), *same)
    np.testing.assert_allclose(
        moved, flux_at(replace(what, attitude=replace(law, pole_lat_deg=72.0)), *at), rtol=1e-9
    )
    lon = np.radians(1e-4)
    circle, turned = np.cos(np.radians(70.0)), np.sin(np.radians(70.0))
    moved = unknowns.flux(jnp.array([circle * lon, 0.0, 0.0]), *same)
    # along the circle of latitude the body turns about its pole by sin β dλ, against the tilt
    other = replace(law, pole_lon_deg=30.0 + 1e-4, phase0_deg=-1e-4 * turned)
    still = flux_at(what, *at)
    change = flux_at(replace(what, attitude=other), *at) - still
    np.testing.assert_allclose(moved - still, change, atol=1e-4 * np.abs(change).max())


def test_bounds_are_said_with_which_is_best_and_worst(tmp_path):
    """By the prior's widths; longitude where it is one, σ/cos β."""
    unknowns = Unknowns.of(spun(tmp_path, 60.0), ["spin"])
    c = Campaign(unknowns, np.diag([1e2, 1e3, 1e4]))
    said = summary.bound_words(c)
    assert said == [
        "bound of spin: best 0.0001 (period, relative), "
        "worst 0.573 deg (eastward tilt of the pole)",
        "bound of the pole: longitude 1.15 deg, latitude 0.0573 deg",
    ]
    c = Campaign(Unknowns.of(spun(tmp_path, 90.0), ["spin"]), c.jacobian)
    assert summary.bound_words(c)[1] == "bound of the pole: latitude 0.0573 deg"
    assert summary.pole_bound(c) == {"longitude": None, "latitude": pytest.approx(0.0573, rel=1e-3)}


def test_lines_keep_within_the_terminal():
    line = "  facets 0 and 6 face the same way, and how one is tilted is not seen at all"
    kept = wrapped(line, 40).splitlines()
    assert len(kept) > 1
    assert max(map(len, kept)) <= 40
    assert [len(x) - len(x.lstrip()) for x in kept] == [2] + [4] * (len(kept) - 1)
    assert " ".join(" ".join(kept).split()) == line.strip()


def test_a_sentence_says_for_how_many_combinations_it_stands():
    many = [Trade(words, np.zeros(1), 0.0, True) for words in ("tilts trade", "dark", "dark")]
    assert summary.sentences(many) == ["tilts trade", "dark (2 combinations)"]


def test_targets_turn_unknowns_into_what_is_asked():
    what = scenario.load("two-facet-spin")
    assert isinstance(what.attitude, ConstantRate)
    unknowns = Unknowns.of(what)
    pole = of_unknowns(unknowns, "pole")
    assert pole.unit == "deg"
    omega = np.array(what.attitude.omega_rad_s)
    change = np.array([1e-7, -2e-7, 3e-7])
    theta = np.zeros(len(unknowns.parameters))
    theta[:3] = change
    moved = np.linalg.norm(pole.factor[0] / unknowns.prior_sd @ theta)
    after = omega + change
    angle = np.degrees(
        np.arcsin(
            np.linalg.norm(np.cross(omega, after)) / np.linalg.norm(omega) / np.linalg.norm(after)
        )
    )
    assert moved == pytest.approx(angle, rel=1e-4)
    assert of_unknowns(unknowns, "normal:1").factor.shape == (1, 2, 9)
    assert of_unknowns(unknowns, "all").unit == "1"
    with pytest.raises(InputError, match="target 'nose' is not unknown here; choose from pole"):
        of_unknowns(unknowns, "nose")


def test_a_plan_beats_equal_steps_and_counts_visits(panel, measured, everything):
    m = measured["flux"]
    kept = np.r_[3 : everything.jacobian.shape[1]]
    result = Campaign(Unknowns.of(panel["flux"], USUAL), everything.jacobian[:, kept])
    factor, target = campaign_plan.from_prior(result, "normal:1")
    plan = campaign_plan.plan(factor, target, m.curve, 4, visit_s=8.0)
    assert sum(map(len, plan.visits)) == m.curve.n_obs
    assert max(map(len, plan.visits)) == 2
    assert plan.schedule.sd[-1] < plan.even.sd[-1] < plan.schedule.sd[0]
    assert plan.even_needed is None or plan.even_needed >= 4
    rows = summary.schedule(plan, m)
    assert [row["rank"] for row in rows] == [1, 2, 3, 4]
    assert rows[0]["n_measurements"] == 2
    with pytest.raises(InputError, match="99 visits are asked for, and 16 are possible"):
        campaign_plan.plan(factor, target, m.curve, 99, visit_s=8.0)


def test_an_error_within_which_the_brightness_bends_is_reported():
    """Against the profile χ² by least squares of its own, and the share falls as the noise does."""
    what = scenario.load("two-facet-spin")
    off = {}
    for snr in (10.0, 100.0):
        loud = replace(what, noise=Noise("snr", snr))
        m = measure(loud)
        result = campaign(Unknowns.of(loud), m)
        off[snr] = nonlinearity(result, m)
    np.testing.assert_allclose(off[100.0], off[10.0] / 10.0, rtol=0.5, atol=1e-3)
    sd, prior, weight = result.bound_with_prior, result.unknowns.prior_sd, flux_weight(m)
    i = int(np.argmax(off[100.0]))
    epochs = tuple(map(jnp.asarray, (m.curve.t, m.curve.sun, m.curve.obs)))
    flux = jax.jit(lambda theta: result.unknowns.flux(theta, *epochs))
    clean, ends = np.asarray(flux(jnp.zeros(9))), []
    for side in (-2.0, 2.0):

        def residuals(others, side=side):
            theta = np.insert(others, i, side * sd[i])
            return np.concatenate([(np.asarray(flux(theta)) - clean) * weight, theta / prior])

        scale = np.delete(sd, i)
        ends.append(2.0 * least_squares(residuals, np.zeros(8), x_scale=scale, xtol=1e-10).cost)
    expected = np.max(np.abs(np.sqrt(ends) / 2.0 - 1.0))
    assert off[100.0][i] == pytest.approx(expected, rel=0.02)
    assert off[100.0][i] < MAX_NONLINEARITY < off[10.0][i]


def test_unknown_groups_are_named():
    with pytest.raises(InputError, match="unknown group of parameters 'shape'; available: att"):
        Unknowns.of(scenario.load("one-facet"), ["shape"])
    with pytest.raises(InputError, match="has nothing unknown in spin"):
        Unknowns.of(scenario.load("one-facet"), ["spin"])
