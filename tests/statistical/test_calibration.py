"""Simulation-based calibration, short: the pipeline of `lcbayes.fit` on curves from the prior."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from lcbayes.core.errors import InputError
from lcbayes.tasks.calibrate import run as calibration
from lcbayes.tasks.calibrate.run import Calibration, calibrate
from tests.helpers import small_curves
from tests.helpers.false_alarms import EACH

OPTIONS: dict[str, Any] = {"n_facets": 1, "spin": "none", "log_area_mean": 1.5, "log_area_sd": 0.5}
SHORT: dict[str, Any] = {"num_warmup": 100, "num_samples": 250, "num_chains": 2, "num_starts": 24}


@pytest.mark.statistical(false_alarm=EACH)
@pytest.mark.parametrize("n", [3, pytest.param(12, marks=pytest.mark.slow)])
def test_fits_hold_the_truth_as_often_as_they_say(n):
    result = calibrate(
        small_curves.curve(20, noise=0.1), "faceted", n=n, seed=2, **OPTIONS, **SHORT
    )
    assert result.names == ("albedo_area[0]", "g[0]", "phi[0]", "log_likelihood")
    assert result.places.shape == (n, 4)
    assert result.p_values().min() > EACH / 4


@pytest.mark.slow
def test_narrow_draws_are_found_out():
    """Posteriors half as wide as they are: the same machinery must notice."""
    scalars = calibration.scalars

    def narrowed(sites):
        return {
            k: np.median(v) + 0.3 * (v - np.median(v)) if v.size > 1 else v
            for k, v in scalars(sites).items()
        }

    result = calibrate(
        small_curves.curve(20, noise=0.1),
        "faceted",
        n=80,
        seed=2,
        quantities=narrowed,
        **OPTIONS,
        **SHORT,
    )
    assert result.p_values()[:-1].min() < EACH / 4
    assert result.coverage(0.9)[:-1].max() < 0.8


def test_coverage_counts_central_intervals():
    places = np.array([[0.04, 0.5], [0.3, 0.96], [0.5, 0.5], [0.8, 0.2]])
    result = Calibration(("a", "b"), places, np.ones(4, bool))
    np.testing.assert_array_equal(result.coverage(0.9), [0.75, 0.75])
    np.testing.assert_array_equal(result.coverage(0.5), [0.5, 0.5])


def test_scales_that_depend_on_the_data_have_no_prior_to_draw_from():
    curve = small_curves.curve(20)
    with pytest.raises(InputError, match="known scale"):
        calibrate(replace(curve, free_scale=np.array([True])), "faceted", n=1, **OPTIONS)


def test_scatter_in_units_of_the_mean_flux_has_no_prior_to_draw_from(tmp_path):
    """A model that adds scatter to the errors, in units of what the curve itself is bright."""
    (tmp_path / "loose.py").write_text(
        """
from lcbayes.modelling import likelihood as noise, priors
from lcbayes.physics import brightness

SUMMARY = "one facet, scatter beyond the errors"


def model(data):
    normals, area = priors.normals(1), priors.albedo_area(1)
    flux = brightness.flux(data.sun, data.obs, normals, area, "lambertian")
    noise.observe(data, flux, scatter_median=0.05)
"""
    )
    with pytest.raises(InputError, match="give a curve in magnitudes"):
        calibrate(small_curves.curve(20), str(tmp_path / "loose.py"), n=1)
