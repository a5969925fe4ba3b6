"""Glints: found without false alarms, and turned into directions with their uncertainty."""

from __future__ import annotations

import numpy as np
import pytest

from lcbayes.core.constants import SUN_ANGULAR_RADIUS
from lcbayes.core.errors import InputError
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.glints import analyse
from lcbayes.inversion.glints.detect import detect
from lcbayes.inversion.glints.directions import (
    CHI2_90,
    Sighting,
    bisector,
    cylinder,
    facet,
    facets,
    tracking,
)
from lcbayes.inversion.glints.instants import instants, rounding
from lcbayes.physics.attitude.laws import ConstantRate
from lcbayes.physics.bodies.facets import across as axes_across
from lcbayes.results.reasons import reason as sentence
from tests.helpers.false_alarms import EACH, counts, limit, squares
from tests.helpers.simulated_glints import (
    facet_flashes,
    no_flashes,
    panel_flashes,
    random_unit,
    wire_flashes,
)

T = np.arange(0.0, 300.0, 0.5)
ONE = np.zeros(T.size, int)


def test_the_bisector_halves_the_phase_angle():
    rng = np.random.default_rng(1)
    sun, obs = random_unit(rng), random_unit(rng)
    b = bisector(sun, obs)
    assert b @ sun == pytest.approx(b @ obs)
    assert b @ sun == pytest.approx(np.cos(0.5 * np.arccos(sun @ obs)))
    assert np.linalg.det([b, sun, obs]) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.statistical(false_alarm=EACH)
def test_noise_glints_no_more_often_than_is_said():
    rng = np.random.default_rng(2)
    trials = 300
    false = 0
    for _ in range(trials):
        flux = 2.0 + 0.5 * np.sin(T / 70.0) + 0.05 * rng.normal(size=T.size)
        false += bool(detect(T, flux, np.full(T.size, 0.05), ONE, 6.0, alarm=0.05)[0])
    assert false <= counts(trials, 0.05)[1]  # Bonferroni errs on the safe side


@pytest.mark.statistical(false_alarm=EACH)
@pytest.mark.parametrize("fwhm", [0.7, 3.0, 7.0])
def test_time_width_and_height_of_a_glint(fwhm):
    rng = np.random.default_rng(3)
    shape = np.exp(-4 * np.log(2) * ((T - 150.2) / fwhm) ** 2)
    flux = 2.0 + 0.002 * T + 3.0 * shape + 0.03 * rng.normal(size=T.size)
    (result,), _ = detect(T, flux, np.full(T.size, 0.03), ONE, 8.0)
    assert abs(result.t - 150.2) < limit() * result.t_error
    assert result.t_error < 0.5
    assert result.height == pytest.approx(3.0, rel=0.1 if fwhm > 1 else 0.5)
    assert result.fwhm == pytest.approx(fwhm, rel=0.1 if fwhm > 1 else 0.5)
    assert result.resolved == (fwhm > 1)
    assert result.baseline == pytest.approx(2.3, rel=0.05)  # it rises where a glint is long


def test_a_slow_brightening_is_no_glint():
    flux = 2.0 + np.exp(-0.5 * ((T - 150) / 40.0) ** 2) + 0.2 * np.sin(T / 6.0)
    rng = np.random.default_rng(4)
    flux += 0.01 * rng.normal(size=T.size)
    assert detect(T, flux, np.full(T.size, 0.01), ONE, 4.0)[0] == []


def turning(t, brightness, error, kind="flux"):
    """A light curve under a bisector that moves by a twentieth of a degree per second."""
    a = np.radians(20.0 + 0.1 * (t - t[0]))
    return LightCurve(
        t=t,
        brightness=brightness,
        error=error,
        kind=kind,
        range_km=np.full(t.size, 1000.0),
        sun=np.tile([0.6, 0.0, 0.8], (t.size, 1)),
        obs=np.stack([np.cos(a), np.sin(a), 0 * a], 1),
    )


@pytest.mark.statistical(false_alarm=EACH)
@pytest.mark.parametrize("times", ["rounded", "twice"])
def test_points_of_one_time_make_no_glints_and_hide_none(times):
    t = np.arange(0.0, 600.0, 0.4)
    if times == "twice":
        t = np.repeat(t, 2)
    rng = np.random.default_rng(9)
    flux = 1.0 + sum(3.0 * np.exp(-0.5 * ((t - peak) / 2.0) ** 2) for peak in (200.0, 400.0))
    flux += 0.02 * rng.normal(size=t.size)
    recorded = np.round(t) if times == "rounded" else t
    unit = 1.0 if times == "rounded" else 0.4
    result = analyse(turning(recorded, flux, np.full(t.size, 0.02)))
    assert len(result.glints) == 2
    for one, peak in zip(result.glints, (200.0, 400.0), strict=True):
        assert one.t_error == pytest.approx(unit)
        assert abs(one.t - peak) < unit
        assert one.fwhm == pytest.approx(2.0 * np.sqrt(8.0 * np.log(2.0)), rel=0.1)
        assert abs(recorded[one.row] - one.t) <= unit  # a row of the light curve as it was given
    assert result.facets == []  # of one normal they are not


@pytest.mark.statistical(false_alarm=EACH)
@pytest.mark.parametrize("known", [True, False])
def test_magnitudes_that_scatter_widely_glint_no_more_often_than_is_said(known):
    rng = np.random.default_rng(10)
    trials, t = 100, np.arange(300.0)
    error = np.full(t.size, 0.3) if known else None
    false = sum(
        bool(analyse(turning(t, rng.normal(10.0, 0.3, t.size), error, "mag")).glints)
        for _ in range(trials)
    )
    assert false <= counts(trials, 0.01)[1]


def test_a_bright_point_stands_out_among_magnitudes_that_scatter_widely():
    """Ten standard deviations in magnitude, where the error of its flux is a quarter of it."""
    t = np.arange(300.0)
    magnitude = np.random.default_rng(11).normal(10.0, 0.3, t.size)
    magnitude[150] = 7.0
    (one,) = analyse(turning(t, magnitude, np.full(t.size, 0.3), "mag")).glints
    assert one.row == 150


def test_means_over_instants():
    t = np.array([1.0, 3.0, 1.0, 1.0, 8.0])
    label = np.array([0, 0, 0, 1, 0])
    value, error = np.array([2.0, 5.0, 6.0, 7.0, 9.0]), np.array([1.0, 2.0, 2.0, 3.0, 4.0])
    rows, mean, sigma = instants(t, label, value, error)
    assert rows.tolist() == [0, 1, 3, 4]
    assert mean == pytest.approx([(2.0 + 6.0 / 4.0) / 1.25, 5.0, 7.0, 9.0])
    assert sigma == pytest.approx([1.25**-0.5, 2.0, 3.0, 4.0])
    assert rounding(t) == 2.0
    assert rounding(t[[0, 1, 4]]) == 0.0


def sighted(rng, normal, t_error=0.1, fwhm=4.0, rate=0.004):
    """A sighting whose bisector is off the normal by errors as large as it claims."""
    e1, e2 = axes_across(normal)
    angle = rng.uniform(0, 2 * np.pi)
    along, across = (
        np.cos(angle) * e1 + np.sin(angle) * e2,
        -np.sin(angle) * e1 + np.cos(angle) * e2,
    )
    claimed = Sighting(normal, rate * along, t_error, fwhm).errors()
    b = normal + claimed[0] * rng.normal() * along + claimed[1] * rng.normal() * across
    return Sighting(b / np.linalg.norm(b), rate * along, t_error, fwhm)


@pytest.mark.statistical(false_alarm=EACH)
def test_normals_of_facets_lie_in_their_regions_as_often_as_said():
    rng = np.random.default_rng(5)
    trials, held, chi2 = 400, 0, 0.0
    for _ in range(trials):
        n = random_unit(rng)
        result = facet([sighted(rng, n) for _ in range(4)], range(4))
        held += result.holds(n)
        chi2 += result.chi2
    low, high = counts(trials, 0.9, 2)
    assert low <= held <= high
    low, high = squares(6 * trials, 2)
    assert low < chi2 < high


@pytest.mark.statistical(false_alarm=EACH)
def test_axes_of_cylinders_lie_in_their_regions_as_often_as_said():
    rng = np.random.default_rng(6)
    trials, held = 400, 0
    for _ in range(trials):
        c = random_unit(rng)
        seen = []
        for _ in range(5):
            e1, e2 = axes_across(c)
            turn = rng.uniform(0, 2 * np.pi)
            b = np.cos(turn) * e1 + np.sin(turn) * e2
            rate = rng.uniform(0.002, 0.01) * c
            off = np.hypot(np.linalg.norm(rate) * 0.5, 0.5 * SUN_ANGULAR_RADIUS) * rng.normal()
            b = b + off * c
            seen.append(Sighting(b / np.linalg.norm(b), rate, 0.5, 2.0))
        result = cylinder(seen, range(5))
        held += result is not None and result.holds(c, axis=True)
    low, high = counts(trials, 0.9)
    assert low <= held <= high


def test_the_region_is_that_of_the_covariance():
    rng = np.random.default_rng(7)
    result = facet([sighted(rng, random_unit(rng))], [0])
    values, vectors = np.linalg.eigh(result.covariance)
    edge = np.sqrt(CHI2_90 * values[2]) * vectors[:, 2]
    assert result.ellipse[0] == pytest.approx(np.linalg.norm(edge))
    assert result.holds(result.vector + 0.98 * edge)
    assert not result.holds(result.vector + 1.05 * edge)
    assert not result.holds(-result.vector)


def test_glints_of_two_facets_are_not_joined():
    rng = np.random.default_rng(8)
    one = random_unit(rng)
    other = axes_across(one)[0]
    seen = [sighted(rng, n) for n in (one, other, one, other, one)]
    groups = facets(seen)
    assert sorted(g.members for g in groups) == [(1, 3), (4, 0, 2)] or {
        frozenset(g.members) for g in groups
    } == {frozenset({0, 2, 4}), frozenset({1, 3})}


def test_the_offset_of_a_panel_is_an_angle_about_the_axis():
    """A panel behind the Sun by an angle, and the bisector that it faces, put together by hand."""
    axis = np.array([0.0, 0.0, 1.0])
    for offset in (-0.15, 0.0, 0.3):
        sun = np.array([np.cos(0.4) * np.cos(0.2), np.sin(0.4) * np.cos(0.2), np.sin(0.2)])
        b = np.array([np.cos(0.4 + offset), np.sin(0.4 + offset), 0.05])
        seen = Sighting(b / np.linalg.norm(b), np.array([0.0, 0.0, 0.0]), 10.0, 60.0)
        result = tracking([seen, seen], np.array([sun, sun]), np.zeros((2, 3)), axis)
        assert result.offsets == pytest.approx([offset, offset])
        assert result.mean == pytest.approx(offset)
        assert result.sun == pytest.approx([0.2, 0.2])


def facet_found(seed: int) -> bool:
    """Whether the region of 90 % holds the normal."""
    curve, attitude, normal = facet_flashes(seed, 50.0)
    result = analyse(curve, attitude)
    assert result.cylinder is None
    return result.facets[0].holds(normal)


def wire_found(seed: int) -> bool:
    curve, attitude, axis = wire_flashes(seed, 50.0)
    result = analyse(curve, attitude)
    assert result.cylinder is not None
    assert not result.reasons
    return result.cylinder.holds(axis, axis=True)


@pytest.mark.statistical(false_alarm=EACH)
def test_a_facet_a_wire_and_a_panel_are_found_and_distinguished():
    """Seven regions of 90 % in a row miss once in ten million times; the panel by its error."""
    assert any(facet_found(seed) for seed in range(3, 10))
    assert any(wire_found(seed) for seed in range(3, 10))
    curve, pole, offset = panel_flashes(3, 50.0)
    result = analyse(curve, axis=pole)
    assert result.panel is not None
    assert abs(result.panel.mean - offset) < limit(2) * result.panel.error


@pytest.mark.statistical(false_alarm=EACH)
def test_where_conditions_fail_nothing_is_given():
    """Noise glints in one of 100 light curves: in three in a row once in a million times."""
    none = "no-glint"
    assert any(
        [r.code for r in analyse(no_flashes(s, 50.0)).reasons] == [none] for s in range(3, 6)
    )
    curve, attitude, _ = facet_flashes(3, 50.0)
    wrong = ConstantRate((0.02, 0.03, 0.01))
    assert analyse(curve, wrong).reasons
    first = analyse(curve, attitude).glints[0]
    alone = analyse(curve.select(np.abs(curve.t - first.t) < 40.0), attitude)
    assert len(alone.glints) == 1
    assert "one glint alone fixes no direction" in sentence(alone.reasons[0]).text
    with pytest.raises(InputError, match="has no spin"):
        analyse(curve, attitude, axis=(0.0, 0.0, 1.0))
