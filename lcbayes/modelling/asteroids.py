"""What models of an asteroid share: period, size, phase law, and the starts of a search."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpyro
import numpyro.distributions as dist
from numpyro.distributions import constraints
from numpyro.distributions.transforms import (
    AffineTransform,
    ComposeTransform,
    ExpTransform,
    SoftplusTransform,
)

from lcbayes.core.constants import HOUR_S
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.modelling import priors
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.recorded import Sites
from lcbayes.physics import photometry
from lcbayes.physics.attitude import rotations
from lcbayes.physics.bodies import facets

LAW = "lommel-seeliger-lambert"
SPHERE = 8.0  # Σα of a sphere with flux 1 at zero phase angle and c = 0: ∫ μ/2 dΩ = π/2
LOG_LAMBERT = (np.log(0.1), 0.5)
MIN_LAMBERT = 0.03
LINEAR_LAMBERT = ComposeTransform(  # x to ln c: c ≈ x above the minimum, exponential in x below
    [
        AffineTransform(0.0, 1.0 / MIN_LAMBERT),
        SoftplusTransform(),
        AffineTransform(0.0, MIN_LAMBERT, domain=constraints.positive),
        ExpTransform().inv,
    ]
)


def spin(data: Epochs, period: float) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Pole (3,), shift of the period in units of P²/2T, and sidereal period, s, as sites.

    The pole is uniform on the sphere. Sidereal period ~ Normal(period, P²/2T), with ``period`` in
    h and T the time span.
    """
    pole = priors.directions("pole", 1)[0]
    priors.pole_angles(pole)
    shift = jnp.asarray(numpyro.sample("period_shift", dist.Normal(0.0, 1.0)))
    length = period_s(data, period, shift)
    numpyro.deterministic("period_h", length / HOUR_S)
    return pole, shift, length


def lambert() -> jax.Array:
    """Weight c of Lambert's term: ln c ~ Normal(ln 0.1, 0.5)."""
    c = jnp.exp(numpyro.sample("log_lambert_c", dist.Normal(*LOG_LAMBERT)))
    numpyro.deterministic("lambert_c", c)
    return c


def period_s(data: Epochs, period: float, shift: jax.Array) -> jax.Array:
    """Sidereal period, s, from one in h and a shift in units of P²/2T, T the time span."""
    given = period * HOUR_S
    return given + shift * given**2 / (2.0 * data.t_span)


def rotating(
    data: Epochs,
    pole: jax.Array,
    period_s: jax.Array,
    seen: Callable[[jax.Array, jax.Array], jax.Array],
    phase_s: jax.Array | float = 0.0,
) -> jax.Array:
    """Flux (T,) of a body that rotates steadily, averaged over exposures.

    ``seen`` gives the flux from the directions to Sun and observer, (T, 3) in body axes. These are
    `rotations.brought_to` of the pole at the middle of the data, ``phase_s`` earlier.
    """
    tilt = rotations.brought_to(pole)

    def instantaneous(t: jax.Array) -> jax.Array:
        rotation = rotations.spinning(t - data.t_middle + phase_s, tilt, period_s)
        return seen(rotations.to_body(rotation, data.sun), rotations.to_body(rotation, data.obs))

    mean = photometry.exposed(instantaneous, data.exposure_s)
    return (mean if data.has_exposure else instantaneous)(data.t)


def typical(data: Epochs) -> jax.Array:
    """Mean flux of the calibrated points, at unit distance and irradiance."""
    known = ~jnp.asarray(data.free_scale)[data.curve]
    linear = data.brightness
    if data.kind == "mag":
        linear = 10.0 ** (-0.4 * (linear - data.zero_point))
    return jnp.sum(jnp.where(known, linear / data.dilution, 0.0)) / jnp.sum(known)


def calibration(data: Epochs, c: jax.Array) -> jax.Array | float:
    """Σα/8 of the body, which only calibrated curves constrain; 1 without them.

    The data constrain F = Σα (1/8 + c/6) much better than Σα or c. With Σα as a coordinate, the
    posterior would be a narrow curved ridge in Σα and c, on which chains move slowly.
    """
    if not data.calibrated:
        return 1.0
    flux = jnp.exp(numpyro.sample("log_sphere_flux", dist.Normal(jnp.log(typical(data)), 1.0)))
    return flux / (1.0 + 4.0 * c / 3.0)


def n_phase_laws(data: Epochs) -> int:
    """Phase laws M of a light curve: one for all calibrated curves, one for each in `phased`."""
    return int(data.calibrated) + len(data.phased)


def phase_law(data: Epochs) -> jax.Array | float:
    """S of each epoch (T,), which only curves constrain that cover a range of phase angles; 1
    without them.

    The parameters are vectors if there are several laws: of the calibrated curves, if there are
    any, then of the relative ones with a law of their own, most points first. All other curves
    have the first law.
    """
    count = n_phase_laws(data)
    if not count:
        return 1.0
    each = (count,) if count > 1 else ()
    a = jnp.exp(numpyro.sample("log_phase_a", dist.Normal(np.log(0.5), 0.5).expand(each)))
    d = jnp.exp(numpyro.sample("log_phase_d", dist.Normal(np.log(0.1), 0.5).expand(each)))
    k = jnp.asarray(numpyro.sample("phase_k", dist.Normal(-0.5, 0.3).expand(each)))
    numpyro.deterministic("phase_a", a)
    numpyro.deterministic("phase_d", d)
    if each:
        law = np.zeros(data.n_members + 1, int)
        law[list(data.phased)] = np.arange(count - len(data.phased), count)
        a, d, k = (x[jnp.asarray(law)[data.member]] for x in (a, d, k))
    return photometry.phase_law(data.phase_angle, a, d, k)


def pole_of(sites: Sites) -> jax.Array:
    """The unit vector along the pole, (3,)."""
    base = sites["pole_base"][0]
    return base / jnp.linalg.norm(base)


def spins() -> list[Sites]:
    """Poles over the whole sky and periods within the prior, from which a search starts."""
    return [
        {"pole_base": jnp.asarray(pole)[None], "period_shift": jnp.array(shift)}
        for pole in facets.grid(12)
        for shift in (-1.0, -0.5, 0.0, 0.5, 1.0)
    ]


def light(data: Epochs) -> Sites:
    """Surface, levels and noise from which a search starts."""
    start = {
        "log_lambert_c": jnp.log(0.1),
        "log_level": jnp.zeros(sum(data.free_scale)),
        "log_sigma": jnp.log(0.03),
        "noise_unit": jnp.zeros(len(data.free_scale)),
    }
    if data.calibrated:
        start |= {"log_sphere_flux": jnp.log(typical(data))}
    if count := n_phase_laws(data):
        each = jnp.ones(count if count > 1 else ())
        start |= {"log_phase_a": jnp.log(0.5) * each, "log_phase_d": jnp.log(0.1) * each}
        start |= {"phase_k": -0.5 * each}
    return start
