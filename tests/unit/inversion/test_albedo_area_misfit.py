"""What an albedo-area distribution says of bodies that shade themselves, and of plain ones."""

from __future__ import annotations

import numpy as np
import pytest

from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.albedo_area import cues, misfit
from lcbayes.inversion.albedo_area.distribution import grid, solve
from lcbayes.inversion.albedo_area.facets import Facets, explain
from lcbayes.inversion.albedo_area.inversion import InversionSettings, invert
from lcbayes.inversion.albedo_area.kernel import LAMBERTIAN, columns
from lcbayes.inversion.albedo_area.observed import Observed
from lcbayes.physics.attitude.laws import Fixed
from lcbayes.physics.bodies import facets, shapes
from lcbayes.physics.bodies.closure import close
from lcbayes.results.reasons import reason as sentence
from tests.helpers.false_alarms import EACH, counts
from tests.helpers.known_bodies import curve_of, directions
from tests.helpers.l_shaped_body import boxes, flux

ONE = (LAMBERTIAN,)


def l_shaped(arm: float, snr: float, with_errors: bool = True, n: int = 300) -> LightCurve:
    rng = np.random.default_rng(1)
    sun, obs = directions(rng, n), directions(rng, n)
    clean = flux(boxes(arm) if arm else boxes(0.0)[:1], sun, obs)
    error = np.full(n, clean.mean() / snr)
    return LightCurve(
        t=np.arange(float(n)),
        brightness=clean + error * rng.normal(size=n),
        error=error if with_errors else None,
        sun=sun,
        obs=obs,
    )


def codes(curve: LightCurve) -> set[str]:
    return {
        r.code
        for r in invert(curve, Fixed(), settings=InversionSettings(n_bootstrap=0, n_null=0)).reasons
    }


@pytest.mark.parametrize(("arm", "with_errors"), [(0.15, True), (0.6, False)])
def test_a_body_that_shades_itself_is_not_trusted(arm, with_errors):
    """By 1.5 % of its light with known errors, where χ² per degree of freedom is below 2."""
    estimate = codes(l_shaped(arm, 40.0, with_errors))
    assert estimate & {"misfit", "residuals-follow-geometry"}
    assert not codes(l_shaped(0.0, 40.0, with_errors)) & {"misfit", "residuals-follow-geometry"}


def test_facets_that_stand_for_shading_are_named():
    result = invert(
        l_shaped(0.3, 50.0), Fixed(), settings=InversionSettings(n_bootstrap=0, n_null=0)
    )
    (text,) = [sentence(r).text for r in result.reasons if r.code == "insignificant-facets"]
    assert result.facets is not None
    smallest = f"{result.facets.areas.min():.3g}"
    assert smallest in text
    assert result.facets.areas.min() < 0.3  # no such face on the body


@pytest.mark.slow
@pytest.mark.statistical(false_alarm=EACH)
def test_residuals_of_a_convex_body_follow_geometry_no_more_often_than_said():
    body, low = shapes.box(2.0, 1.4, 0.8), 0
    for seed in range(60):
        curve = curve_of(body, 120, 0.02, seed=seed)
        seen = Observed.of(curve, Fixed())
        normals, which = grid(100)
        matrix = columns(seen, normals, which)
        _, few = explain(seen, solve(seen, normals, which, matrix), matrix, ONE)
        low += misfit.geometry_p_value(seen, few.flux, seed) <= 0.05
    assert low <= counts(60, 0.05)[1]


def on_grid(seen: Observed):
    normals, which = grid(200)
    matrix = columns(seen, normals, which)
    estimate = solve(seen, normals, which, matrix)
    return estimate, matrix, explain(seen, estimate, matrix, ONE)[1]


def test_right_angles_of_a_box_do_not_depend_on_whether_its_faces_stand_out(monkeypatch):
    """Facets found to 2° are tested for their angles though no cluster is significant."""
    seen = Observed.of(curve_of(shapes.box(1.0, 1.5, 1.5), 160, 0.02, seed=3), Fixed())
    estimate, matrix, few = on_grid(seen)
    assert len(few.areas) == 6
    none = cues.Cue("clusters", 0.0, 0.22, "", "", {"clusters": [], "n_flat": 0})
    monkeypatch.setattr(cues, "_clusters", lambda *_: none)
    by_name = {c.name: c for c in cues.find(seen, estimate, matrix, few, ONE, n_null=1, seed=1)}
    assert by_name["angle-90"].p_value < 0.005
    assert not by_name["angle-60"].significant


def test_facets_that_stand_for_a_smooth_body_are_not_tested_for_angles():
    fine = facets.grid(1500)
    for axes in ((1.0, 1.0, 1.0), (1.6, 1.1, 0.8)):
        raw = np.linalg.norm(fine * np.array(axes), axis=1) ** -4.0
        body = shapes.body(fine, close(fine, raw / raw.sum()))
        for n, noise in ((60, 0.05), (200, 0.02)):
            seen = Observed.of(curve_of(body, n, noise, seed=2), Fixed())
            estimate, matrix, few = on_grid(seen)
            assert isinstance(few, Facets)
            assert not cues.faceted(seen, estimate, matrix, few)
