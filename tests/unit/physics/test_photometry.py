"""Magnitudes, bands, exposures and scales against hand-computed numbers."""

import math

import numpy as np
import pytest

from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.physics import photometry as ph


def test_magnitude_by_hand():
    """1 m² that sends 1/π to 1000 km under a −26.76 mag Sun: −26.76 + 2.5 log₁₀π + 30."""
    m = ph.magnitude(jnp.array([1 / math.pi]), 1e6, ph.sun_magnitude("V"))
    assert m[0] == pytest.approx(-26.76 + 2.5 * math.log10(math.pi) + 30.0, abs=1e-12)
    assert m[0] == pytest.approx(4.4829, abs=1e-4)


def test_magnitude_is_the_flux_ratio_in_watts():
    """Hinks' (3): m = −26.7 − 2.5 log₁₀(F_obs/C_sun) with F_obs = 455 f/d²."""
    f, d = jnp.array([0.4, 3.0]), jnp.array([4e7, 5e5])
    watts = ph.irradiance(f, d)
    np.testing.assert_allclose(watts, 455.0 * f / d**2)
    np.testing.assert_allclose(
        ph.magnitude(f, d, ph.sun_magnitude("hinks")), -26.7 - 2.5 * np.log10(watts / 455.0)
    )


def test_a_dark_epoch_is_infinitely_faint_with_zero_slope():
    f = jnp.array([0.0, 1.0])
    assert np.isposinf(ph.magnitude(f, 1.0, 0.0)[0])
    slope = jax.grad(lambda f: ph.magnitude(f, 1.0, 0.0)[1])(f)
    np.testing.assert_allclose(slope, [0.0, -2.5 / math.log(10)])
    assert jax.jacrev(lambda f: ph.magnitude(f, 1.0, 0.0))(f)[0, 0] == 0.0


def test_the_sun_in_each_band():
    assert ph.sun_magnitude("V") == ph.sun_magnitude("") == -26.76  # Willmer 2018
    assert ph.sun_magnitude("B") == -26.13
    # colours of the Sun in the AB system: g − r 0.46, r − i 0.12
    assert ph.sun_magnitude("g") - ph.sun_magnitude("r") == pytest.approx(0.46)
    assert ph.sun_magnitude("r") - ph.sun_magnitude("i") == pytest.approx(0.12)
    with pytest.raises(InputError, match="unknown band 'W1'; available: hinks, U, B, V"):
        ph.sun_magnitude("W1")


def test_phase_law_by_hand():
    assert ph.phase_law(jnp.float64(0.2), 0.5, 0.1, -0.4) == pytest.approx(
        0.5 * math.exp(-2.0) - 0.08 + 1.0
    )


def test_exposure_averages_the_flux():
    """Mean of 1 + cos ωt over τ: 1 + cos ωt · sin(ωτ/2)/(ωτ/2); a cubic exactly at order 2."""
    t, tau, omega = jnp.linspace(0.0, 5.0, 9), jnp.linspace(0.0, 1.0, 9), 2.0
    mean = ph.exposed(lambda t: 1.0 + jnp.cos(omega * t), tau, order=6)(t)
    half = omega * np.asarray(tau) / 2
    np.testing.assert_allclose(mean, 1 + np.cos(omega * t) * np.sinc(half / np.pi), atol=1e-12)
    cubic = ph.exposed(lambda t: t**3 - t, tau, order=2)(t)
    a, b = np.asarray(t - tau / 2), np.asarray(t + tau / 2)
    exact = (b**4 - a**4) / 4 - (b**2 - a**2) / 2
    np.testing.assert_allclose(cubic[1:], (exact / np.where(tau > 0, tau, 1.0))[1:], rtol=1e-10)
    assert cubic[0] == t[0] ** 3 - t[0]
    slope = jax.grad(lambda w: jnp.sum(ph.exposed(lambda t: jnp.cos(w * t), tau)(t)))(2.0)
    assert np.isfinite(slope)
