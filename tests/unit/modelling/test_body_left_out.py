"""Shadows that a fit of a known body leaves out: against rays, refits and a light curve with them.

The body is a bar with an arm, drawn and lit by `tests.helpers.l_shaped_body`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lcbayes.core.jax_setup import jnp
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inference import alternatives, robustness
from lcbayes.inference.misfit_tests import examine
from lcbayes.inference.solutions import optimum
from lcbayes.modelling import registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem, compiled
from lcbayes.models import body
from lcbayes.results import summary
from lcbayes.results.reasons import cause, reason
from lcbayes.simulation.known_bodies.reader import read_body_text
from tests.helpers.shaded_bar import (
    ALBEDO,
    ARM,
    ATTITUDE,
    OMEGA,
    T,
    bar,
    curve,
    shaded_flux,
)


def fitted(text: str, light: LightCurve, **given):
    """The problem of a body, its data and options, and the optimum next to the truth."""
    entry, data = registry.find("body"), Epochs.of(light)
    options = entry.check({"body": text, "clock_sd": 0.0, "rate_drift_sd": 0.0, **given})
    problem = Problem(entry.bind(options), data)
    middle = Rotation.from_rotvec(float(data.t_middle) * OMEGA).as_matrix() @ ATTITUDE
    sites = {
        "rate_unit": 0.7,
        "attitude_base": Rotation.from_matrix(middle).as_quat(scalar_first=True),
        "paint_r_diff": ALBEDO,
        "log_brightness": np.log(ALBEDO * read_body_text(text).body.areas["paint"]),
        "log_box2_z": np.log(ARM),
    }
    z = problem.ravel({k: jnp.asarray(sites[k], float) for k in problem.names})
    return problem, data, options, np.asarray(z)


def left_out(problem, data, options, z):
    sites = compiled(problem.constrain)(jnp.asarray(z), data)
    result = body.shadows_left_out([sites], data, **options)
    assert result is not None
    return result, sites


@pytest.mark.slow
@pytest.mark.parametrize("length", [ARM, "{ median = 0.4, factor = 1.5 }"])
def test_light_that_shadows_take_is_that_of_rays(length):
    result, sites = left_out(*fitted(bar(length=length), curve(shaded_flux(), 30.0)))
    expected = shaded_flux()
    # without shadows, the faces by which the parts touch are lit too
    np.testing.assert_allclose(sites["flux"] + result[0], expected, atol=0.01 * expected.max())
    assert np.abs(result).max() > 0.2 * expected.max()


def test_shadows_of_the_model_or_of_a_lone_part_are_not_left_out():
    data = Epochs.of(curve(shaded_flux(), 30.0))
    lone = bar()[: bar().rindex("[[body.parts]]")] + bar()[bar().index("[materials") :]
    assert body.shadows_left_out([{}], data, body=bar(shadows=True)) is None
    assert body.shadows_left_out([{}], data, body=lone) is None


def test_shadows_of_a_symmetric_body_are_found_for_a_free_spin():
    """The body's symmetry is first asked for while the shadows are traced."""
    read_body_text.cache_clear()
    entry, data = registry.find("body"), Epochs.of(curve(shaded_flux(), 30.0))
    options = entry.check({"body": "rocket-stage", "spin": "free", "shadows": False})
    problem = Problem(entry.bind(options), data)
    result, sites = left_out(problem, data, options, np.full(problem.dim, 0.1))
    assert np.all(result <= 1e-12)
    assert np.all(sites["flux"] + result[0] >= -1e-12)
    assert result.min() < 0.0


@pytest.mark.slow
def test_shadows_are_named_and_their_shift_is_that_of_a_refit():
    noise = np.random.default_rng(3).standard_normal(T.size)
    clean = shaded_flux()
    light = curve(clean, 40.0)
    assert light.error is not None
    light = replace(light, brightness=clean + light.error * noise)
    problem, data, options, truth = fitted(bar(), light)
    rows = np.arange(problem.dim)
    best, _ = optimum(problem, data, truth, rows)
    change, sites = left_out(problem, data, options, best)
    further = alternatives.shadows(problem, best, data, change[0])
    result = examine(problem, best, data, light, further=further).cause
    assert result is not None
    assert result.name == "shadows"
    assert result.amount == pytest.approx(1.0, abs=0.3)
    assert "shade one another" in cause(result)

    sd = {f"omega_{k}_rad_s": 1e-4 for k in "xyz"}
    moved = robustness.shifts(problem, best, data, light, sd, change)
    # the same light curve but for the shadows
    whole = data.brightness - change[0]
    without, _ = optimum(problem, replace(data, brightness=jnp.asarray(whole)), best, rows)
    there = compiled(problem.constrain)(jnp.asarray(without), data)["omega"]
    refit = np.abs(np.asarray(there) - np.asarray(sites["omega"])) / 1e-4
    np.testing.assert_allclose(moved.by_fault["shadows"], refit, rtol=0.25, atol=0.1 * refit.max())

    missed = summary._AtOptimum(None, best, change, 0.05)  # pyright: ignore[reportArgumentType]
    (one,) = summary._ignored(missed, moved)
    assert "take 5 % of the light" in reason(one).text
    small = replace(moved, by_fault={"shadows": np.array([0.4, 0.1, 0.2])})
    assert not list(summary._ignored(missed, small))
