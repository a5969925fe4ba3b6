"""From flux to observed quantities: magnitudes, phase law, finite exposures, scale per curve."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from lcbayes.core.constants import SOLAR_FLUX_VISIBLE
from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp

# Distance modulus of 1 au: 5 log10(1 au / 10 pc).
_MODULUS = -31.5721

# The Sun's absolute magnitude per band: value, system. Willmer 2018, ApJS 236, 47, table 3
# (accurate to 0.03); G: Casagrande & VandenBerg 2018, MNRAS 479, L102.
_SUN_ABSOLUTE = {
    "U": (5.61, "Vega"),  # Johnson
    "B": (5.44, "Vega"),
    "V": (4.81, "Vega"),
    "R": (4.43, "Vega"),  # Cousins
    "I": (4.10, "Vega"),
    "G": (4.67, "Vega"),  # Gaia
    "B_AB": (5.31, "AB"),  # Johnson
    "V_AB": (4.80, "AB"),
    "u": (6.39, "AB"),  # SDSS
    "g": (5.11, "AB"),
    "r": (4.65, "AB"),
    "i": (4.53, "AB"),
    "z": (4.50, "AB"),
}

SUN_MAGNITUDE: dict[str, float] = {
    "hinks": -26.7,  # Hinks et al. 2013, eq. (3): band not stated
    **{band: round(value + _MODULUS, 2) for band, (value, _) in _SUN_ABSOLUTE.items()},
}
"""Apparent magnitude of the Sun at 1 au."""


def sun_magnitude(band: str = "V") -> float:
    """Apparent magnitude of the Sun at 1 au in a band; an empty name means V.

    Raises
    ------
    InputError
        If the band is not one of `SUN_MAGNITUDE`.
    """
    try:
        return SUN_MAGNITUDE[band or "V"]
    except KeyError:
        known = ", ".join(SUN_MAGNITUDE)
        raise InputError(f"unknown band {band!r}; available: {known}") from None


def magnitude(flux: jax.Array, range_m: jax.Array | float, m_sun: jax.Array | float) -> jax.Array:
    """Apparent magnitude of reflected sunlight, m = m_sun − 2.5 log₁₀(f/r²).

    Parameters
    ----------
    flux : (T,) m²
        Σ α f_r μ₀ μ, the flux at unit distance under unit irradiance (1 au).
    range_m : (T,) m
        Distance between body and observer.
    m_sun : scalar or (T,)
        Apparent magnitude of the Sun in the band, from `sun_magnitude`.

    Returns
    -------
    (T,) mag
        +inf, with zero derivative, where the flux is zero.

    References
    ----------
    Hinks, Linares & Crassidis 2013, eq. (3).
    """
    bright = flux > 0.0
    safe = jnp.where(bright, flux, 1.0)
    m = m_sun - 2.5 * jnp.log10(safe) + 5.0 * jnp.log10(range_m)
    return jnp.where(bright, m, jnp.inf)


def irradiance(
    flux: jax.Array, range_m: jax.Array | float, solar: float = SOLAR_FLUX_VISIBLE
) -> jax.Array:
    """Energy flux at the observer, Φ_sun f/r², W/m² in the band of `solar`.

    References
    ----------
    Linares & Crassidis, eq. (4).
    """
    return solar * flux / range_m**2


def phase_law(
    phase: jax.Array, a: jax.Array | float, d: jax.Array | float, k: jax.Array | float
) -> jax.Array:
    """Dependence on the phase angle (rad): a exp(−phase/d) + k phase + 1.

    References
    ----------
    Kaasalainen, Torppa & Muinonen 2001, Icarus 153, 37.
    """
    return a * jnp.exp(-phase / d) + k * phase + 1.0


def exposed(
    brightness: Callable[[jax.Array], jax.Array], exposure_s: jax.Array, order: int = 3
) -> Callable[[jax.Array], jax.Array]:
    """Average an instantaneous flux over the exposure, by Gauss-Legendre quadrature.

    f̄(t) = ½ Σₖ wₖ f(t + xₖ τ/2), exact if f is a polynomial of degree 2·order − 1 during the
    exposure. The average is over fluxes, not magnitudes: apply it before `magnitude`.

    Parameters
    ----------
    brightness : callable
        t (T,) s -> flux (T,), or several quantities (K, T).
    exposure_s : (T,) s
        Duration of the exposure centred on each t.
    order : int
        Number of nodes per exposure.

    Returns
    -------
    callable
        t (T,) s -> mean flux (T,), or (K, T).
    """
    nodes, weights = np.polynomial.legendre.leggauss(order)

    def mean(t: jax.Array) -> jax.Array:
        instants = t + 0.5 * jnp.asarray(nodes)[:, None] * exposure_s
        return jnp.tensordot(0.5 * jnp.asarray(weights), jax.vmap(brightness)(instants), 1)

    return mean
