"""Two ellipsoids in contact that rotate about a fixed pole: an asteroid that shades itself."""

import numpy as np
import numpyro
import numpyro.distributions as dist

from lcbayes.core.jax_setup import jnp
from lcbayes.modelling import asteroids, likelihood, priors, zero_points
from lcbayes.modelling.epochs import Epochs
from lcbayes.physics.bodies import contact_binary

SUMMARY = "two ellipsoids in contact that shade one another, principal-axis spin"
RIVAL = "convex-grid"
COARSER = {"n_quadrature": 200}
DEEPEST = 0.2  # distance of the centres over that at contact
SIZE_SD = 0.4  # of the logarithm of the ratio of both sizes
PHASES = 4  # in the equator, from which a search starts
LOG_BA, LOG_CB = (-0.15, 0.2), (-0.1, 0.2)


def model(
    data: Epochs,
    *,
    period: float,
    n_quadrature: int = 400,
    noise_law: likelihood.Law = "gaussian",
    scatter: float = 0.0,
    correlated_noise: bool = False,
    zero_point_sd: float = 0.0,
):
    """f(t) = S(phase) Σ αᵢ vᵢ [μ₀μ/(μ₀+μ) + c μ₀μ] over the surface of two ellipsoids.

    v is the part of a patch that the other ellipsoid neither shades nor hides; see
    `physics.bodies.contact_binary`. The albedo is uniform.

    The pole is uniform on the sphere, and the rotational phase on the circle. Sidereal period ~
    Normal(period, P²/2T), with T the time span. The line of centres turns in the equator. The
    semi-axes a along that line, b in the equator and c along the pole have the ratios ln b/a ~
    Normal(−0.15, 0.2) and ln c/b ~ Normal(−0.1, 0.2) in each ellipsoid. The ratio of both sizes,
    radii of spheres of the same volume, has ln r ~ Normal(0, 0.4). The distance of the centres over
    that at contact is uniform in 0.2 to 1. ln c ~ Normal(ln 0.1, 0.5) for Lambert's term. Size,
    phase laws and noise are those of convex-grid.

    The two ellipsoids may be exchanged; see `equivalents`.

    Parameters
    ----------
    period
        Sidereal period, h.
    n_quadrature
        About the number of patches of each ellipsoid. The search uses 200.
    noise_law
        gaussian, student-t or mixture.
    scatter
        Median of the prior of the scatter in excess of the file's errors, mag or relative; 0: none.
    correlated_noise
        Whether the noise includes an Ornstein-Uhlenbeck process of unknown size and time scale.
    zero_point_sd
        Prior sd of the zero point of each observer and night of calibrated curves, mag; 0: equal.
    """
    pole, _, period_s = asteroids.spin(data, period)
    phase_s = priors.angle("phase") / (2.0 * np.pi) * period_s

    ratio = jnp.exp(numpyro.sample("log_size_ratio", dist.Normal(0.0, SIZE_SD)))
    numpyro.deterministic("size_ratio", ratio)
    axis_ba, axis_cb = (
        jnp.exp(numpyro.sample(f"log_{name}", dist.Normal(*prior).expand([2]).to_event(1)))
        for name, prior in (("axis_ba", LOG_BA), ("axis_cb", LOG_CB))
    )
    numpyro.deterministic("axis_ba", axis_ba)
    numpyro.deterministic("axis_cb", axis_cb)
    separation = numpyro.sample("separation", dist.Uniform(DEEPEST, 1.0))
    body = contact_binary.lobes(ratio, axis_ba, axis_cb, separation)

    lambert = asteroids.lambert()
    size = asteroids.calibration(data, lambert)
    if data.calibrated:
        numpyro.deterministic("total_albedo_area", asteroids.SPHERE * size)
    surface = asteroids.phase_law(data)

    def seen(sun, obs):
        return contact_binary.flux(sun, obs, body, asteroids.LAW, lambert, n_quadrature)

    flux = asteroids.SPHERE * asteroids.rotating(data, pole, period_s, seen, phase_s)
    zero_point = zero_points.Prior(zero_point_sd)
    flux = surface * size * flux
    likelihood.observe(data, flux, noise_law, scatter, False, zero_point, correlated_noise)


def shapes(data: Epochs, **options):  # noqa: ARG001
    """Bodies in contact and with a neck, at four phases."""
    light = asteroids.light(data)
    return [
        light
        | {
            "phase_base": jnp.array([[np.cos(angle), np.sin(angle)]]),
            "log_size_ratio": jnp.log(0.8),
            "log_axis_ba": jnp.full(2, LOG_BA[0]),
            "log_axis_cb": jnp.full(2, LOG_CB[0]),
            "separation": jnp.array(separation),
        }
        for separation in (0.6, 0.9)
        for angle in 2.0 * np.pi * np.arange(PHASES) / PHASES
    ]


def starts(data: Epochs, key, **options):  # noqa: ARG001
    """Poles over the whole sky and periods within the prior, with one separation each in turn."""
    every = shapes(data, **options)
    return [
        shape | spin
        for k, spin in enumerate(asteroids.spins())
        for shape in every[k % 2 * PHASES :][:PHASES]
    ]


def equivalents(**options):  # noqa: ARG001
    """The body, and with its ellipsoids in the other order, turned by half a turn."""
    same, other = np.eye(2), np.eye(2)[::-1]
    return [
        {
            "log_size_ratio": np.array([[sign]]),
            "log_axis_ba": order,
            "log_axis_cb": order,
            "phase_base": sign * np.eye(2),
        }
        for sign, order in ((1.0, same), (-1.0, other))
    ]


def coordinates(data: Epochs, **options):  # noqa: ARG001
    """c of Lambert's term replaces ln c above the lower end of its prior, as in convex-grid."""
    return {"log_lambert_c": asteroids.LINEAR_LAMBERT}
