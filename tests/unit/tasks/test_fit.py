"""What a fit says that it rests on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lcbayes.core.errors import InputError
from lcbayes.data.lightcurve import LightCurve
from lcbayes.modelling import registry
from lcbayes.tasks.fit import run as fitting
from lcbayes.tasks.fit.assumptions import assumptions
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
    told = assumptions(small_curves.curve(), registry.find(model), options)
    assert any(line.startswith(said) for line in told)
    assert any(line.startswith(ERRORS) for line in told)
    assert any("Gaussian" in line for line in told) == said.endswith("Gaussian.")


def test_unsure_directions_of_flight_are_reported():
    """Places to 10 m or 10 km over six seconds: directions to some 0.003 and some 3 degrees."""
    t = np.linspace(0.0, 6.0, 30)
    turn = np.stack([np.cos(1.1e-3 * t), np.sin(1.1e-3 * t), 0.0 * t], axis=1)
    for km, told in ((0.01, False), (10.0, True)):
        place = 6900.0 * turn + km * np.random.default_rng(2).uniform(-0.5, 0.5, turn.shape)
        curve = small_curves.curve(t=t, position_km=place, frame="icrs")
        said = assumptions(curve, registry.find("stabilised"), {})
        assert any(line.startswith("Directions of flight") for line in said) == told


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
            "the mean flux of the curve b is not positive",
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
