"""The orientation of a single facet: parts by brute force, the whole on simulated passes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from facets_in_pass import body_directions, crossing, flux_of, one_pass, with_noise
from false_alarms import EACH

from lcbayes.errors import InputError
from lcbayes.physics import catalogue, facets
from lcbayes.separated import single_facet as module
from lcbayes.separated.reduced import reduce
from lcbayes.separated.single_facet import single_facet

LVLH = catalogue.find("lvlh")


@pytest.fixture(scope="module")
def case():
    """A facet that goes out of view of both sites, one after the other."""
    curve = one_pass(3, step=4.0)
    return curve, crossing(curve, LVLH, 5)


def apart(a, b):
    return np.degrees(np.arccos(np.clip(a @ b, -1, 1)))


@pytest.mark.statistical(false_alarm=EACH)
def test_the_normal_is_found(case):
    curve, normal = case
    found = single_facet(with_noise(curve, flux_of(curve, LVLH, normal, 1.0), 0.01, 1), LVLH)
    assert not found.reasons
    assert apart(found.normal, normal) < 1.0
    nearest = found.fall[np.argmax(found.normals @ normal)]
    assert nearest > found.fall.max() + 2.0 * np.log(EACH)  # chi2 of 2
    assert found.albedo_area == pytest.approx(0.3, rel=0.05)
    assert sum(found.kind.values()) == pytest.approx(1.0)


@pytest.mark.parametrize("kind", ["visibility", "illumination"])
def test_two_sites_tell_visibility_from_illumination(kind):
    """Edges by hand, from the sign of n·o and of n·s; sites see the Sun's edge at one time."""
    curve = one_pass(3, step=4.0)
    sun, obs = body_directions(curve, LVLH)
    sites = [np.flatnonzero(curve.site == k) for k in "01"]
    for normal in facets.grid(3000):
        lit, seen = sun @ normal > 0, obs @ normal > 0
        flag, other = (seen, lit) if kind == "visibility" else (lit, seen)
        inner = [flag[r][len(r) // 5 : -len(r) // 5] for r in sites]
        bright = np.max(np.where(lit & seen, (sun @ normal) * (obs @ normal), 0.0))
        if other.all() and all(x.any() and not x.all() for x in inner) and bright > 0.05:
            break
    else:
        pytest.fail("no such normal")
    found = single_facet(with_noise(curve, flux_of(curve, LVLH, normal, 1.0), 0.005, 0), LVLH)
    assert not found.reasons
    assert found.kind[kind] > 0.95
    for e in found.edges:
        rows = np.flatnonzero(curve.site == e.site)
        k = rows[np.flatnonzero(np.diff(flag[rows]))[0]]
        assert abs(e.t - curve.t[k] - 2.0) < 2.5 + 4 * e.error
    assert {e.site for e in found.edges} == {"0", "1"}
    times = [e.t for e in found.edges]
    assert (np.ptp(times) < 1e-6) == (kind == "illumination")


def test_the_fall_of_chi2_is_that_of_a_fit(case):
    """D of a few normals against a least-squares fit with and without the facet."""
    from scipy.optimize import nnls

    curve, normal = case
    seen = reduce(with_noise(curve, flux_of(curve, LVLH, normal, 1.0), 0.05, 2))
    sun, obs = (v[seen.row] for v in body_directions(curve, LVLH))
    problem, rest = module._problem(seen, sun, obs)
    tried = np.concatenate([normal[None], np.eye(3), -np.eye(3)])
    got = problem.scores(tried, problem.target[:, None])[:, 0]
    white = rest / seen.error[:, None]
    y = seen.flux / seen.error
    plain = np.sum((y - white @ np.linalg.lstsq(white, y, rcond=None)[0]) ** 2)
    for n, fall in zip(tried, got, strict=True):
        facet = np.maximum(sun @ n, 0) * np.maximum(obs @ n, 0) / np.pi / seen.error
        # the rest may have either sign, the facet may not
        _, left = nnls(np.column_stack([white, -white, facet]), y, maxiter=10_000)
        assert plain - left**2 == pytest.approx(fall, abs=1e-4 * plain)


def test_cells_have_equal_area_and_cover_the_sphere():
    """A quadrature of 1, n and n nᵀ over the cells."""
    normals, corner = module._cells(module.CELLS)
    np.testing.assert_allclose(normals.mean(axis=0), 0.0, atol=1e-12)
    np.testing.assert_allclose(3 * normals.T @ normals / len(normals), np.eye(3), atol=1e-3)
    lower = module._middle(corner, np.zeros(2))
    assert np.degrees(np.arccos(np.min(np.sum(lower * normals, axis=1)))) < 6  # at the poles


@pytest.mark.statistical(false_alarm=EACH)
def test_without_an_edge_nothing_is_claimed(case):
    """Noise alone passes for an edge once in 20 times or less, five times running hardly ever."""
    curve, _ = case
    smooth = flux_of(curve, LVLH, np.array([1.0, 0, 0]), 0.0)
    told = (single_facet(with_noise(curve, smooth, 0.02, s), LVLH).reasons for s in range(4, 9))
    assert any("no edge of a facet is seen" in reason for one in told for reason in one)


@pytest.mark.statistical(false_alarm=EACH)
@pytest.mark.slow
def test_chance_edges_are_as_rare_as_they_should_be():
    """p ≤ 0.05 in 5 % of 100 smooth curves; binomial."""
    from scipy import stats

    hits = 0
    for seed in range(100):
        curve = one_pass(seed, step=4.0)
        smooth = flux_of(curve, LVLH, np.array([1.0, 0, 0]), 0.0)
        hits += single_facet(with_noise(curve, smooth, 0.02, seed), LVLH, seed=seed).p_value <= 0.05
    assert stats.binomtest(hits, 100, 0.05).pvalue > EACH


def test_conditions_that_are_not_met_are_said(case):
    curve, normal = case
    measured = with_noise(curve, flux_of(curve, LVLH, normal, 1.0), 0.01, 1)
    with pytest.raises(InputError, match=r"no pass has 20 points \(the longest has 10\)"):
        single_facet(measured.select(np.flatnonzero(curve.site == "0")[:10]), LVLH)
    still = replace(measured, obs=np.broadcast_to(measured.obs[100], measured.obs.shape))
    told = single_facet(still, catalogue.find("inertial")).reasons
    assert any("passes of low orbits" in reason for reason in told)
    bumpy = replace(measured, brightness=measured.brightness * (1 + 0.3 * np.sin(measured.t / 9.0)))
    told = single_facet(bumpy, LVLH).reasons
    assert any("does not explain the curve" in reason for reason in told)
    with pytest.raises(InputError, match=r"needs the satellite's orbit"):
        single_facet(replace(measured, position_km=None, velocity_km_s=None), LVLH)
