"""What a fit says that it rests on."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import xarray as xr

import lcbayes
from lcbayes.core.errors import InputError
from lcbayes.core.reasons import Reason
from lcbayes.data.lightcurve import LightCurve
from lcbayes.modelling import registry
from lcbayes.tasks.fit import run as fitting
from lcbayes.tasks.fit.assumptions import assumptions
from lcbayes.tasks.fit.result import Fit
from tests.helpers import small_curves

ERRORS = "The errors of the file are taken as they are, independent"


@pytest.mark.parametrize(
    ("model", "options", "said"),
    [
        ("faceted", {}, ERRORS + " and Gaussian."),
        ("faceted", {"noise_law": "student-t"}, "Noise follows Student's t"),
        ("faceted", {"noise_law": "mixture"}, "Some points are outliers"),
        ("stabilised", {"scatter": 0.0}, "Noise follows Student's t"),  # by default
    ],
)
def test_the_law_of_noise_is_named(model, options, said):
    stated = assumptions(small_curves.curve(), registry.find(model), options)
    assert any(line.startswith(said) for line in stated)
    assert any(line.startswith(ERRORS) for line in stated)
    assert any("Gaussian" in line for line in stated) == said.endswith("Gaussian.")


def test_unsure_directions_of_flight_are_reported():
    """Places to 10 m or 10 km over six seconds: directions to some 0.003 and some 3 degrees."""
    t = np.linspace(0.0, 6.0, 30)
    turn = np.stack([np.cos(1.1e-3 * t), np.sin(1.1e-3 * t), 0.0 * t], axis=1)
    for km, expected in ((0.01, False), (10.0, True)):
        place = 6900.0 * turn + km * np.random.default_rng(2).uniform(-0.5, 0.5, turn.shape)
        curve = small_curves.curve(t=t, position_km=place, frame="icrs")
        stated = assumptions(curve, registry.find("stabilised"), {})
        assert any(line.startswith("Directions of flight") for line in stated) == expected


def relative(level: float, **changes) -> LightCurve:
    light = small_curves.curve(20, error=changes.pop("error", np.full(20, 0.1)))
    flux = light.brightness - light.brightness.mean() + level
    return replace(light, brightness=flux, **({"free_scale": np.array([True])} | changes))


@pytest.mark.parametrize(
    ("curve", "said"),
    [
        (relative(-0.1), "the mean flux of the curve is not positive"),
        (replace(relative(1.0), brightness=np.zeros(20)), "the mean flux of the curve is not pos"),
        (
            replace(
                relative(1.0), brightness=np.zeros(20), error=None, free_scale=np.zeros(1, bool)
            ),
            "every flux of the curve is 0 and there are no errors",
        ),
        (
            replace(
                relative(-0.01),
                curve=np.arange(20) // 10,
                curve_names=("a", "b"),
                brightness=np.repeat([1.0, -1.0], 10),
                free_scale=np.ones(2, bool),
            ),
            "the mean flux of curve b is not positive",
        ),
    ],
)
def test_fluxes_without_a_level_are_refused(curve, said):
    with pytest.raises(InputError, match=said):
        fitting.check_curve(curve)


@pytest.mark.parametrize(
    "curve",
    [relative(0.1), relative(-0.1, free_scale=np.zeros(1, bool)), relative(0.1, error=None)],
)
def test_fluxes_about_zero_that_have_a_level_are_fitted(curve):
    fitting.check_curve(curve)


def test_the_number_of_facets_from_the_sparse_prior():
    """Two facets of at most three are needed, and the fit with two says how they were found."""
    found = lcbayes.fit(
        small_curves.curve(40, 2),
        sparse=3,
        spin="none",
        num_starts=16,
        num_warmup=50,
        num_samples=50,
        num_chains=2,
    )
    path = found.content.get("sparse", {})
    assert found.content["n_facets"] == path["n_facets"] == 2
    assert path["upper_bound"] == 3
    area = found.posterior["albedo_area"].mean(("chain", "draw")).to_numpy()
    np.testing.assert_allclose(sorted(area), sorted(small_curves.AREAS), rtol=0.2)
    weight = path["sparsity"]
    assert weight == pytest.approx(50.0 / small_curves.AREAS.sum() ** 2, rel=0.2)
    (said,) = [line for line in json.loads(found.tree.attrs["assumptions"]) if "squared-L1" in line]
    assert "facets below 2% of the albedo-area are dropped" in said
    assert f"weight {weight:.3g} /m⁴" in said


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"n_facets": 2}, "--sparse finds the number of facets, and --n-facets gives it"),
        ({"model": "stabilised"}, "goes with faceted and faceted-brdf"),
    ],
)
def test_the_sparse_prior_is_refused_where_it_has_no_meaning(options, said):
    with pytest.raises(InputError, match=said):
        lcbayes.fit(small_curves.curve(20), sparse=3, **options)


@pytest.mark.parametrize(
    ("model", "options", "said"),
    [
        ("faceted", {"spin": "torque-free"}, ["It is rigid and no torque acts on it"]),
        (
            "faceted",
            {"nutation_sd": 0.5, "nutation_ratio": 0.6, "spin": "free"},
            ["The body nutates by some 0.5 deg"],
        ),
        ("convex-grid", {"period": 5.8}, ["Its sidereal period is near 5.8 h"]),
        (
            "convex-grid",
            {"period": 9.213700368920003},
            ["Its sidereal period is near 9.213700369 h", "Options: period = 9.213700369."],
        ),
        (
            "body",
            {"body": "rocket-stage", "spin": "free"},
            [
                "It turns at a constant angular velocity, about any axis",
                "The angle about its axis of symmetry does not matter",
            ],
        ),
        ("body", {"body": "rocket-stage"}, ["It turns at a constant rate about its axis ("]),
    ],
)
def test_the_motion_is_stated(model, options, said):
    stated = assumptions(small_curves.curve(), registry.find(model), options)
    for words in said:
        assert any(line.startswith(words) for line in stated), stated


@pytest.mark.parametrize(
    ("sites", "options", "expected"),
    [
        ("ABAB", {}, True),
        ("AAAA", {}, False),
        ("AABB", {}, False),  # each in one night
        ("ABAB", {"nutation_ratio": 0.5}, False),
        ("ABAB", {"zero_point_sd": 0.0}, False),
    ],
)
def test_what_the_nights_of_a_site_share_is_stated(sites, options, expected):
    t = np.array([0.0, 1.0, 86400.0, 86401.0])
    curve = small_curves.curve(4, t=t, site=np.array(list(sites)))
    stated = assumptions(curve, registry.find("faceted"), options)
    said = "a priori 50 % of their variance, is common to all nights of a site."
    assert any(line.endswith(said) for line in stated) == expected, stated


@pytest.mark.parametrize(("sd", "said"), [(0.051, "0.583 ± 0.05"), (0.0, "0.583")])
def test_a_weight_is_printed_with_its_error(sd, said):
    modes = [
        {"weight": weight, "weight_sd": sd, "rms": 0.05, "parameters": {}}
        for weight in (0.583, 0.417)
    ]
    content: Any = {"modes": modes, "fit": {"chi2": 100.0, "rms_unit": "mag"}}
    tree = xr.DataTree.from_dict({f"/modes/{i}/posterior": xr.Dataset() for i in range(2)})
    lines = Fit(tree, content, []).lines()
    assert f"solution 1: weight {said}, rms 0.05 mag" in lines


def test_a_pattern_in_the_residuals_is_named_in_a_fit_that_is_refused():
    late = {"name": "late-curve", "version": "curve 2", "amount": -10.0, "sd": 1.0, "gain": 50.0}
    quality = {
        "chi2": None,
        "rms_unit": "mag",
        "p_limit": 0.001,
        "tests": [{"name": "night", "p_value": 1e-4, "upper_limit": False}],
        "alternatives": [late | {"p_value": 1e-5, "rough": False}],
    }
    modes = [{"weight": 1.0, "weight_sd": 0.0, "rms": 0.05, "parameters": {}}]
    tree = xr.DataTree.from_dict({"/modes/0/posterior": xr.Dataset()})
    content: Any = {"modes": modes, "fit": quality}
    refused = Fit(tree, content, [Reason("chains-disagree", "the chains disagree")])
    assert not refused.trusted
    first = refused.lines()[0]
    assert "the residuals show a pattern" in first
    assert "the times of curve 2 are 10.0 ± 1.0 min too late" in first


def test_notes_of_a_file_keep_the_names_of_its_columns():
    light = small_curves.curve()
    noted = replace(light, source=dict(light.source) | {"notes": "sun_x .. sun_z are odd"})
    said = assumptions(noted, registry.find("faceted"), {})
    assert said[-1] == "Noted on reading the file: sun_x .. sun_z are odd."


@pytest.mark.parametrize(("body", "several"), [("plate", False), ("box-wing", True)])
def test_a_body_of_one_part_has_no_parts_that_shade_one_another(body, several):
    stated = " ".join(assumptions(small_curves.curve(40), registry.find("body"), {"body": body}))
    assert ("Its parts shade and hide one another." in stated) == several


@pytest.mark.parametrize(
    ("model", "options", "said"),
    [
        ("faceted", {"n_facets": 1}, True),
        ("faceted", {"n_facets": 1, "rate_drift_sd": 0.02}, False),
        ("body", {"body": "plate"}, True),
        ("body", {"body": "plate", "rate_drift_sd": 0.01}, False),
    ],
)
def test_a_rate_that_is_constant_in_the_search_is_said(model, options, said):
    """The search has the drift from the first if that is given."""
    curve = small_curves.curve(40)
    later = curve.t + 50_000.0 * (np.arange(40) >= 20)
    stated = " ".join(assumptions(replace(curve, t=later), registry.find(model), options))
    assert "The rate of rotation may change by" in stated
    assert ("The search for solutions takes it as constant, unless" in stated) == said
