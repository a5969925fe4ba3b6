"""The test of attitude laws by pairs: its parts by brute force, its verdicts on simulated truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from lcbayes.analysis.attitude_test_report import words
from lcbayes.core.errors import InputError
from lcbayes.inversion.separated import attitude_test as module
from lcbayes.inversion.separated import ensemble
from lcbayes.inversion.separated.attitude_test import attitude_test, glints
from lcbayes.inversion.separated.reduced import in_body, reduce, turns
from lcbayes.modelling.ephemeris import ephemeris
from lcbayes.physics.attitude import catalogue
from lcbayes.results.reasons import reason as sentence
from tests.helpers.false_alarms import EACH
from tests.helpers.simulated_passes import measured, passes

LVLH, SUN, INERTIAL = (catalogue.find(n) for n in ("lvlh", "sun-north", "inertial"))


@pytest.fixture(scope="module")
def geometry():
    curve = passes(550.0, 53.0, days=28, step=30.0)
    return curve.select(np.linspace(0, curve.n_obs - 1, 500).astype(int))


def curve_of(geometry, law=LVLH, noise=0.02, seed=0):
    bodies = ensemble.draw(8, np.random.default_rng(seed), bool(law.array))
    return measured(geometry, law, bodies, noise, seed)


def test_pairs_are_all_that_are_alike(geometry):
    """By comparing every point with every other; followers are those that no stray divides."""
    seen = reduce(curve_of(geometry))
    ((sun, obs),) = in_body(turns(LVLH, ephemeris(geometry), seen), seen)
    reach = np.deg2rad(4.0)
    result = module.alike([(sun, obs)], seen, reach)
    angle = np.maximum(*(np.arccos(np.clip(v @ v.T, -1, 1)) for v in (sun, obs)))
    expected = set()
    for i in range(len(seen.t)):
        stray = False
        for j in range(i + 1, len(seen.t)):
            stray |= bool(
                seen.one_pass[j] != seen.one_pass[i] or angle[i, j] > 2.0 * reach * 1.0005
            )
            if angle[i, j] <= reach and stray:
                expected.add((i, j))
    got = set(zip(result.i.tolist(), result.j.tolist(), strict=True))
    assert got <= expected
    partners = np.bincount(np.array(sorted(expected)).ravel(), minlength=len(seen.t))
    few = {pair for pair in expected if max(partners[list(pair)]) <= module.PARTNERS}
    assert few <= got
    assert len(few) > 20
    np.testing.assert_allclose(result.d, angle[result.i, result.j], atol=1e-6)


def test_pairs_of_an_articulated_body_are_alike_in_both_frames(geometry):
    law = catalogue.find("nadir-sun-array")
    seen = reduce(curve_of(geometry, law))
    parts = in_body(turns(law, ephemeris(geometry), seen), seen)
    result = module.alike(parts, seen, np.deg2rad(6.0))
    assert len(result.i) > 5
    for part in parts:
        for v in part:
            angle = np.arccos(np.clip(np.sum(v[result.i] * v[result.j], axis=1), -1, 1))
            assert np.degrees(angle.max()) <= 6.0 + 1e-6


@pytest.mark.statistical(false_alarm=EACH)
def test_the_true_law_is_kept_and_a_wrong_one_rejected(geometry):
    """Kept at 1 in 20 by the first of five bodies, or by the second...: by none in 3 million."""
    result = attitude_test(curve_of(geometry), [INERTIAL, LVLH, SUN], n_bodies=1009)
    by_name = {v.name: v for v in result.verdicts}
    assert result.verdicts[0].name == "lvlh"
    others = (
        attitude_test(curve_of(geometry, seed=s), [LVLH], n_bodies=1009).verdicts[0].p_value
        for s in range(1, 5)
    )
    assert by_name["lvlh"].p_value > 0.05 or any(p > 0.05 for p in others)
    assert by_name["sun-north"].p_value <= 0.01
    assert result.rejected(by_name["sun-north"]) == (by_name["sun-north"].p_value < 0.01)
    assert not result.reasons
    again = attitude_test(curve_of(geometry), [LVLH], n_bodies=1009)
    assert again.verdicts[0].p_value == by_name["lvlh"].p_value


@pytest.mark.statistical(false_alarm=EACH)
@pytest.mark.slow
def test_p_values_of_the_true_law_are_uniform(geometry, monkeypatch):
    """40 bodies, Kolmogorov-Smirnov.

    Without power a high p-value is not given, so those that are given are not uniform.
    """
    monkeypatch.setattr(module, "_has_power", lambda *_: True)
    p = [
        attitude_test(curve_of(geometry, seed=s), [LVLH], n_bodies=1009, seed=s).verdicts[0].p_value
        for s in range(40)
    ]
    assert stats.kstest(p, "uniform").pvalue > EACH


def test_laws_that_the_data_cannot_tell_apart_are_named(geometry):
    """A circular orbit: the velocity is where LVLH has x."""
    result = attitude_test(curve_of(geometry), [LVLH, catalogue.find("velocity")], n_bodies=100)
    assert {v.same_as for v in result.verdicts} == {("velocity",), ("lvlh",)}
    assert result.verdicts[0].p_value == pytest.approx(result.verdicts[1].p_value, abs=0.03)


def test_one_law_with_several_settings_is_several_laws(geometry):
    """Each told by its settings, and compared by its own axes."""
    laws = [LVLH, *(catalogue.parse(f"sun-spin:period_s={p}") for p in (300.0, 700.0))]
    result = attitude_test(curve_of(geometry), [*laws, laws[1]], n_bodies=100)
    names = {"lvlh", "sun-spin:period_s=300", "sun-spin:period_s=700"}
    assert len(result.verdicts) == 3
    assert {v.name for v in result.verdicts} == names
    assert all(v.same_as == () for v in result.verdicts)


def halves(geometry, seed: int):
    curve = curve_of(geometry, seed=seed)
    half = (np.arange(curve.n_obs) >= 250).astype(int)
    scaled = np.where(half == 1, 7.0, 1.0)
    return replace(
        curve,
        brightness=curve.brightness * scaled,
        error=curve.error * scaled,
        curve=half,
        curve_names=("a", "b"),
        free_scale=np.array([True, True]),
    )


@pytest.mark.statistical(false_alarm=EACH)
def test_curves_of_unknown_scale_are_compared_within(geometry):
    """The true law is kept at 1 in 100 by one of three bodies, but once in a million times."""
    scaled = halves(geometry, 0)
    verdict = attitude_test(scaled, [LVLH], n_bodies=1009).verdicts[0]
    assert verdict.pairs is not None
    others = (
        attitude_test(halves(geometry, s), [LVLH], n_bodies=1009).verdicts[0].p_value
        for s in (1, 2)
    )
    assert verdict.p_value > 0.01 or any(p > 0.01 for p in others)
    seen = reduce(scaled)
    assert np.all(seen.group[verdict.pairs.i] == seen.group[verdict.pairs.j])


def test_glints_are_left_out(geometry):
    """Of a smooth pass with noise exactly the flash is taken for one, and the test goes without."""
    rng = np.random.default_rng(0)
    curve = geometry.select(np.arange(100))
    t = np.arange(100.0)
    flux = 1.0 + 0.3 * np.sin(t / 15.0) + 0.01 * rng.standard_normal(100)
    flux[40:42] *= 2.5
    curve = replace(curve, t=t, site=np.full(100, "0"), brightness=flux, error=np.full(100, 0.01))
    np.testing.assert_array_equal(np.flatnonzero(glints(reduce(curve))), [40, 41])
    result = attitude_test(curve, [INERTIAL], n_bodies=100)
    assert (result.n_glints, result.n_obs) == (2, 98)


def spinning(geometry, seed: int, noise: float = 0.06):
    """A cylinder with a cone-like end that spins about a fixed axis, written down once more."""
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    first = np.cross(axis, [0.3, 0.5, 0.8])
    first /= np.linalg.norm(first)
    triad = np.stack([first, np.cross(axis, first), axis])
    turn = 2 * np.pi * geometry.t / rng.uniform(5.0, 60.0)

    def body(v):
        x, y, z = triad @ v.T
        c, s = np.cos(turn), np.sin(turn)
        return np.stack([c * x + s * y, c * y - s * x, z], axis=1)

    around = 2 * np.pi * np.arange(36) / 36
    side = np.stack([0 * around, np.cos(around), np.sin(around)], axis=1)  # its axis turns over
    normals = np.concatenate([side, [[1.0, 0, 0], [-1.0, 0, 0]]])
    areas = np.concatenate([np.full(36, 6.0 / 36), [0.8, 0.8]])
    sun, obs = body(geometry.sun), body(geometry.obs)
    half = (sun + obs) / np.linalg.norm(sun + obs, axis=1, keepdims=True)
    lobe = 5.0 * np.maximum(half @ normals.T, 0.0) ** 60
    light = np.maximum(sun @ normals.T, 0.0) * np.maximum(obs @ normals.T, 0.0)
    flux = light * (0.3 / np.pi + 0.3 * lobe) @ areas
    error = np.full(len(flux), noise * np.median(flux))
    return replace(geometry, brightness=flux + error * rng.normal(size=len(flux)), error=error)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_no_stabilised_law_is_called_consistent_with_a_spinning_body(geometry, seed):
    """Brightness changes along passes by more than pairs can differ: rejected, or no power."""
    result = attitude_test(spinning(geometry, seed), [INERTIAL, LVLH, SUN], n_bodies=199)
    assert all(result.rejected(v) or not v.tested for v in result.verdicts)
    if not any(v.tested for v in result.verdicts):
        assert {r.code for r in result.reasons} <= {"no-power", "too-few-pairs"}


def test_roughness_is_what_brightness_changes_by_along_passes():
    """Pairs of 0.05 rad whose fluxes differ by κ d f̄ and nothing else."""
    rng = np.random.default_rng(3)
    n, kappa = 200, 4.0
    d = rng.uniform(0.02, 0.08, n)
    flux = np.ones(2 * n)
    flux[n:] = (1.0 + 0.5 * kappa * d) / (1.0 - 0.5 * kappa * d)
    rows = np.arange(n)
    pairs = module.Pairs(rows, rows + n, d, rows, rows + n, d)
    error = np.full(2 * n, 1e-4)
    assert module.roughness(flux[None], error, pairs)[0] == pytest.approx(kappa, rel=0.01)
    # each pair differs by its own allowance: ln(1 + 1), but ln(1 + 10⁶) without roughness
    assert module.statistic(flux[None], error, pairs)[0] == pytest.approx(np.log(2.0), rel=0.05)


def test_too_little_is_said(geometry):
    short = curve_of(geometry).select(np.arange(60))
    result = attitude_test(short, [LVLH, INERTIAL], n_bodies=100)
    assert not any(v.tested for v in result.verdicts)
    assert (
        "no law could be tested; 2 of 2: each has fewer than 60 pairs"
        in sentence(result.reasons[0]).text
    )
    assert all("pairs among" in v.reason for v in result.verdicts)
    bare = replace(short, position_km=None, velocity_km_s=None)
    both = attitude_test(bare, [LVLH, SUN, INERTIAL, catalogue.find("velocity")], n_bodies=100)
    assert "2 of 4: each needs the satellite's orbit" in sentence(both.reasons[0]).text
    assert "observe more passes" in sentence(both.reasons[-1]).text
    assert not any("needs the satellite's orbit" in line for line in words(both))
    assert {"  lvlh, velocity", "2 laws not tested, as said above:"} < set(words(both))
    untested = attitude_test(bare, [LVLH], n_bodies=100).verdicts[0]
    assert "needs the satellite's orbit" in untested.reason
    with pytest.raises(InputError, match=r"gives no errors.*--error"):
        attitude_test(replace(short, error=None), [LVLH])
    with pytest.raises(InputError, match=r"separation_deg is 40; expected"):
        attitude_test(short, [LVLH], separation_deg=40.0)


def test_a_level_that_no_rank_can_reach(geometry):
    """p = 1/(1 + n) at the least, and a law is rejected below the level."""
    with pytest.raises(InputError, match=r"no p-value among 99 bodies .* --bodies 199 or more"):
        attitude_test(curve_of(geometry), [SUN], n_bodies=99)
    result = attitude_test(curve_of(geometry), [SUN], n_bodies=100)
    assert result.rejected(result.verdicts[0])
