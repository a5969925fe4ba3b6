"""The orientation of a single facet: parts by brute force, the whole on simulated passes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lcbayes.analysis.single_facet_report import draw
from lcbayes.analysis.style import Gallery, drawing
from lcbayes.core.errors import InputError
from lcbayes.inversion.separated import single_facet as module
from lcbayes.inversion.separated.reduced import reduce
from lcbayes.inversion.separated.single_facet import single_facet
from lcbayes.physics.attitude import catalogue
from lcbayes.physics.bodies import facets
from lcbayes.results.reasons import reason as sentence
from tests.helpers.false_alarms import EACH
from tests.helpers.single_facet_passes import (
    body_directions,
    crossing,
    flux_of,
    one_pass,
    with_noise,
)

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
    result = single_facet(with_noise(curve, flux_of(curve, LVLH, normal, 1.0), 0.01, 1), LVLH)
    assert not result.reasons
    assert apart(result.normal, normal) < 1.0
    nearest = result.fall[np.argmax(result.normals @ normal)]
    assert nearest > result.fall.max() + 2.0 * np.log(EACH)  # chi2 of 2
    assert result.albedo_area == pytest.approx(0.3, rel=0.05)
    assert sum(result.kind.values()) == pytest.approx(1.0)


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
    result = single_facet(with_noise(curve, flux_of(curve, LVLH, normal, 1.0), 0.005, 0), LVLH)
    assert not result.reasons
    assert result.kind[kind] > 0.95
    for e in result.edges:
        rows = np.flatnonzero(curve.site == e.site)
        k = rows[np.flatnonzero(np.diff(flag[rows]))[0]]
        assert abs(e.t - curve.t[k] - 2.0) < 2.5 + 4 * e.error
    assert {e.site for e in result.edges} == {"0", "1"}
    times = [e.t for e in result.edges]
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
    reasons = (single_facet(with_noise(curve, smooth, 0.02, s), LVLH).reasons for s in range(4, 9))
    assert any(
        "no edge of a facet is seen" in sentence(reason).text for one in reasons for reason in one
    )


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


def test_the_share_is_reported_where_the_facet_is_brightest(case):
    """Where the whole flux is zero, or fitted below it, any facet has all of it and more."""
    curve, normal = case
    facet = flux_of(curve, LVLH, normal, 1.0) - flux_of(curve, LVLH, normal, 0.0)
    site = np.flatnonzero(curve.site == "0")
    facet = facet[site] / facet[site].max()
    lit, k = np.flatnonzero(facet), np.argmax(facet)
    dark = lit[len(lit) // 4] if k > lit.mean() else lit[-len(lit) // 4]
    t = (curve.t[site] - curve.t[site][dark]) / (curve.t[site][k] - curve.t[site][dark])
    flux = 0.05 * facet + t**2 - 0.06
    made = replace(curve.select(site), brightness=flux, error=np.full(len(flux), 1e-4))
    result = single_facet(made, LVLH)
    assert result.model[dark] <= 0.0 < result.model[dark] - result.smooth[dark]
    assert result.share == pytest.approx(0.05 / flux[k], rel=0.1)
    assert any("of the light at most" in sentence(reason).text for reason in result.reasons)


def test_conditions_that_are_not_met_are_said(case):
    curve, normal = case
    measured = with_noise(curve, flux_of(curve, LVLH, normal, 1.0), 0.01, 1)
    with pytest.raises(InputError, match=r"no pass has 20 points \(the longest has 10\)"):
        single_facet(measured.select(np.flatnonzero(curve.site == "0")[:10]), LVLH)
    still = replace(measured, obs=np.broadcast_to(measured.obs[100], measured.obs.shape))
    reasons = single_facet(still, catalogue.find("inertial")).reasons
    assert any("passes of low orbits" in sentence(reason).text for reason in reasons)
    bumpy = replace(measured, brightness=measured.brightness * (1 + 0.3 * np.sin(measured.t / 9.0)))
    reasons = single_facet(bumpy, LVLH).reasons
    assert any("does not explain the curve" in sentence(reason).text for reason in reasons)
    with pytest.raises(InputError, match=r"needs the satellite's orbit"):
        single_facet(replace(measured, position_km=None, velocity_km_s=None), LVLH)


def test_the_figure_shows_the_data(case, tmp_path):
    """Their own limits, whatever is fitted; no line over a gap; the points in the legend."""
    curve, normal = case
    whole = with_noise(curve, flux_of(curve, LVLH, normal, 1.0), 0.05, 1)
    middle = np.median(whole.t)
    result = single_facet(whole.select(np.abs(whole.t - middle) > 40.0), LVLH)

    class Kept(Gallery):
        def add(self, figure, name, *args):
            drawn[name] = figure
            return super().add(figure, name, *args)

    drawn = {}
    with drawing():
        draw(replace(result, smooth=result.smooth - 60.0), Kept(tmp_path))
    axes, flux = drawn["edge"].axes[0], result.seen.flux
    size = 10.0 ** np.floor(np.log10(flux.max()))
    assert np.ptp(axes.get_ylim()) == pytest.approx(1.2 * np.ptp(flux) / size)
    lines = [np.asarray(x.get_xdata(), float) for x in axes.lines if x.get_linestyle() == "-"]
    assert len(lines) == 4  # two passes of two stretches
    assert max(np.diff(x).max() for x in lines) < 40.0
    assert "observed" in [text.get_text() for text in drawn["edge"].legends[0].get_texts()]
