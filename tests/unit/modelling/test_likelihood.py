"""From flux to what was recorded: units, unknown scales, unknown noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpyro import handlers
from scipy import stats

from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jnp
from lcbayes.modelling import likelihood
from lcbayes.modelling.epochs import Epochs
from lcbayes.physics import photometry
from tests.helpers import small_curves


def log_joint(data: Epochs, flux, law: str = "gaussian", **sites) -> float:
    model = handlers.substitute(handlers.seed(likelihood.observe, 0), sites)
    trace = handlers.trace(model).get_trace(data, flux, law)
    return float(
        sum(jnp.sum(s["fn"].log_prob(s["value"])) for s in trace.values() if s["type"] == "sample")
    )


def two_curves(free: bool) -> tuple[Epochs, np.ndarray]:
    light = small_curves.curve(
        8,
        curve=np.repeat([0, 1], 4),
        curve_names=("a", "b"),
        free_scale=np.array([free, free]),
    )
    return Epochs.of(light), np.linspace(0.5, 1.5, 8)


def test_flux_without_ranges_is_the_flux():
    light = small_curves.curve(6)
    flux = jnp.linspace(0.1, 1.0, 6)
    np.testing.assert_array_equal(likelihood.expected(Epochs.of(light), flux, jnp.ones(1)), flux)


def test_flux_with_ranges_is_irradiance():
    light = small_curves.curve(6, range_km=np.linspace(500.0, 900.0, 6))
    flux = jnp.linspace(0.1, 1.0, 6)
    watts = np.asarray(flux) * 455.0 / (1e3 * np.linspace(500.0, 900.0, 6)) ** 2
    np.testing.assert_allclose(likelihood.expected(Epochs.of(light), flux, jnp.ones(1)), watts)


def test_magnitudes_are_those_of_photometry():
    r = np.linspace(500.0, 900.0, 6)
    light = small_curves.curve(
        6,
        kind="mag",
        brightness=np.full(6, 7.0),
        error=np.full(6, 0.1),
        range_km=r,
        band=np.array(["V"] * 6),
    )
    flux = jnp.linspace(0.1, 1.0, 6)
    want = photometry.magnitude(flux, jnp.asarray(1e3 * r), photometry.sun_magnitude("V"))
    result = likelihood.expected(Epochs.of(light), flux, jnp.ones(1))
    np.testing.assert_allclose(result, want, atol=1e-10)
    dark = likelihood.expected(Epochs.of(light), jnp.zeros(6), jnp.ones(1))
    assert np.all(np.isfinite(dark))
    assert np.all(dark - result > 20)


def test_scale_is_log_normal_about_the_level():
    """Sampled levels give the density of scales that are log-normal about observed/predicted.

    With s = level·ŷ/⟨f⟩ the two parametrisations differ by a shift of ln s, so that their
    densities agree without a Jacobian.
    """
    data, flux = two_curves(free=True)
    level = np.array([0.2, -0.4])
    result = log_joint(data, flux, log_level=level)
    observed = np.asarray(data.brightness).reshape(2, 4)
    predicted = flux.reshape(2, 4)
    scale = np.exp(level) * observed.mean(1) / predicted.mean(1)  # in the unit of the data
    centre = np.log(observed.mean(1) / predicted.mean(1))
    want = stats.norm.logpdf(np.log(scale), centre, 1.0).sum()
    sd = np.asarray(data.error).reshape(2, 4)
    want += stats.norm.logpdf(observed, scale[:, None] * predicted, sd).sum()
    np.testing.assert_allclose(result, want, rtol=1e-12)


def test_a_common_factor_of_the_flux_does_not_matter_where_the_scale_is_free():
    data, flux = two_curves(free=True)
    level = np.array([0.1, 0.0])
    np.testing.assert_allclose(
        log_joint(data, flux, log_level=level), log_joint(data, 7.0 * flux, log_level=level)
    )


def test_known_scales_are_one():
    data, flux = two_curves(free=False)
    np.testing.assert_array_equal(likelihood.curve_scales(data, jnp.asarray(flux)), np.ones(2))
    np.testing.assert_allclose(
        log_joint(data, flux),
        stats.norm.logpdf(np.asarray(data.brightness), flux, np.asarray(data.error)).sum(),
    )


def test_only_the_free_curves_are_scaled():
    data, flux = two_curves(free=True)
    data = replace(data, free_scale=(False, True), level=data.level.at[0].set(1.0))
    with handlers.seed(rng_seed=0), handlers.substitute(data={"log_level": jnp.array([0.3])}):
        scale = np.asarray(likelihood.curve_scales(data, jnp.asarray(flux)))
    np.testing.assert_allclose(scale, [1.0, np.exp(0.3) / flux[4:].mean()])


def test_student_t():
    data, flux = two_curves(free=False)
    want = stats.t.logpdf(np.asarray(data.brightness), 4, flux, np.asarray(data.error)).sum()
    np.testing.assert_allclose(log_joint(data, flux, "student-t"), want)


def test_unknown_noise_is_relative_to_each_curve():
    light = small_curves.curve(
        8,
        error=None,
        curve=np.repeat([0, 1], 4),
        curve_names=("a", "b"),
        free_scale=np.array([False, False]),
    )
    data, flux = Epochs.of(light), np.linspace(0.5, 1.5, 8)
    y = np.asarray(data.brightness)
    unit = np.array([0.4, -1.2])  # how far each curve's noise is from the typical one
    levels = 0.05 * np.exp(likelihood.NOISE_SPREAD * unit) * np.abs(y).reshape(2, 4).mean(1)
    want = stats.norm.logpdf(y, flux, np.repeat(levels, 4)).sum()
    want += stats.norm.logpdf(np.log(0.05), np.log(0.03), 1.0) + stats.norm.logpdf(unit).sum()
    got = log_joint(data, flux, log_sigma=jnp.log(0.05), noise_unit=jnp.asarray(unit))
    np.testing.assert_allclose(got, want)


def test_a_negative_scatter_is_refused():
    data, flux = two_curves(free=False)
    with pytest.raises(InputError, match=r"scatter is -1; give the median of its prior, or 0"):
        handlers.seed(likelihood.observe, 0)(data, flux, scatter_median=-1.0)


def test_unknown_law_is_refused():
    data, flux = two_curves(free=False)
    with pytest.raises(ValueError, match="available: gaussian, student-t"):
        log_joint(data, flux, "cauchy")
