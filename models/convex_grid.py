"""A convex body on a fixed grid of normals that rotates about a fixed pole: the asteroid model."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import numpyro
import numpyro.distributions as dist
from jax.scipy.linalg import solve_triangular

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.modelling import asteroids, likelihood, zero_points
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.expansion import Expansion, likely_draws
from lcbayes.modelling.moments import MomentCoordinates
from lcbayes.modelling.problem import compiled
from lcbayes.modelling.relief import EllipsoidWithRelief
from lcbayes.physics import brightness
from lcbayes.physics.attitude import rotations
from lcbayes.physics.bodies import facets

SUMMARY = "smooth convex body on a grid of normals, principal-axis spin: pole, period, shape"
RIVAL = "contact-binary"
CLOSURE_SD = 0.01
MOMENT_DEGREE = 4  # highest degree of the moments that the data constrain; see `coordinates`
LIKELY = 400  # draws about a solution
MANY = 500_000  # epochs × normals, from which on chains follow an expansion
# For the search. With an unknown roughness, a body that begins smooth stays smooth, and its misfit
# becomes noise: relief is cheap only once there is some.
COARSER = {"n_quadrature": 300, "roughness": 2.4}


@lru_cache
def grid(n_facets: int, degree: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Normals (N, 3), harmonics (N, (L+1)² − 1) without the constant, ln of the weights (N,)."""
    normals, weights = facets.rings(n_facets)
    return normals, facets.spherical_harmonics(normals, degree)[:, 1:], np.log(weights)


def model(
    data: Epochs,
    *,
    period: float,
    n_facets: int = 300,
    n_quadrature: int = 600,
    degree: int = 6,
    noise_law: likelihood.Law = "gaussian",
    scatter: float = 0.0,
    correlated_noise: bool = False,
    zero_point_sd: float = 0.0,
    roughness: float = 0.0,
):
    """f(t) = S(phase) Σ αᵢ [μ₀μ/(μ₀+μ) + c μ₀μ], α ∝ exp of harmonics up to a degree.

    The pole is uniform on the sphere. Sidereal period ~ Normal(period, P²/2T), with T the time
    span. The sd is the difference between periods that differ by half a turn over the span. Their
    light curves are similar, so the given period should have about this accuracy.

    The body is an ellipsoid with relief: c₂ₘ ~ Normal(0, 1.5), and the other c_lm deviate from
    those of the ellipsoid by Normal(0, τ (2/(l+1))²) with an unknown τ of about 2.4, which is
    integrated out (`relief.EllipsoidWithRelief`). ln c ~ Normal(ln 0.1, 0.5). Each component of
    Σαn/Σα is 0 ± 0.01: the surface closes within the error of the grid.

    If all curves are relative, the size is not inferred: Σα = 8, as for a sphere with flux 1. With
    a calibrated curve the flux of a sphere with these areas at zero phase, F = Σα (1/8 + c/6), has
    ln F ~ Normal(ln mean calibrated flux, 1), and S = a exp(−phase/d) + k phase + 1 with
    ln a ~ Normal(ln 0.5, 0.5), ln d ~ Normal(ln 0.1, 0.5), k ~ Normal(−0.5, 0.3), phase in rad.
    Each relative curve that covers more than 5 degrees of phase angle, such as the points of a
    survey, has an S of its own, since bands and reductions differ; see `phase_law`. Without such
    curves S = 1. The body's axes at the middle of the data are `attitude.brought_to` of the pole.
    There is no rotational phase, because a rotation about the pole is equivalent to a rotation of
    the areas on the grid.

    Parameters
    ----------
    period
        Sidereal period, h.
    n_facets
        About the number of normals of the areas that are reported.
    n_quadrature
        About the number of normals over which the brightness is summed. The search uses 300.
    degree
        Highest degree of the harmonics.
    noise_law
        gaussian, student-t or mixture.
    scatter
        Median of the prior of the scatter in excess of the file's errors, mag or relative; 0: none.
    correlated_noise
        Whether the noise includes an Ornstein-Uhlenbeck process of unknown size and time scale.
    zero_point_sd
        Prior sd of the zero point of each observer and night of calibrated curves, mag; 0: equal.
    roughness
        τ of the relief if it is known; 0: it is integrated out. The search takes 2.4.

    References
    ----------
    Kaasalainen, Torppa & Muinonen 2001, Icarus 153, 37 (spin, shape series, scattering law).
    """
    normals, harmonics, log_weights = grid(n_quadrature, degree)
    pole, shift, period_s = asteroids.spin(data, period)
    shape = EllipsoidWithRelief(degree, roughness)
    coefficients = jnp.asarray(numpyro.sample("coefficients", shape))
    numpyro.deterministic("roughness", shape.roughness(coefficients))
    share = jax.nn.softmax(harmonics @ coefficients + log_weights)
    numpyro.sample("closure", dist.Normal(share @ normals, CLOSURE_SD).to_event(1), obs=np.zeros(3))
    lambert = asteroids.lambert()
    size = asteroids.calibration(data, lambert)
    surface = asteroids.phase_law(data)
    _, coarse, log_coarse = grid(n_facets, degree)
    reported = jax.nn.softmax(coarse @ coefficients + log_coarse)
    numpyro.deterministic("albedo_area", asteroids.SPHERE * size * reported)

    if isinstance(data.expansion, Expansion):
        flux = data.expansion(
            _motion(pole, shift, data.expansion.axes), asteroids.SPHERE * share, lambert
        )
    else:
        flux = _light(data, normals, pole, period_s, asteroids.SPHERE * share, lambert)
    zero_point = zero_points.Prior(zero_point_sd)
    flux = surface * size * flux
    likelihood.observe(data, flux, noise_law, scatter, False, zero_point, correlated_noise)


def _light(data: Epochs, normals, pole, period_s, area, lambert) -> jax.Array:
    """Flux of all facets, without the phase law, (T,)."""
    n = jnp.asarray(normals)

    def seen(sun, obs):
        return brightness.flux(sun, obs, n, area, asteroids.LAW, lambert, single_slopes=True)

    return asteroids.rotating(data, pole, period_s, seen)


def _motion(pole: jax.Array, shift: jax.Array, axes: jax.Array) -> jax.Array:
    """Gnomonic coordinates of the pole about the third of the axes (3, 3), and the shift."""
    x, y, z = pole @ axes
    return jnp.stack([x / z, y / z, shift])


def guide(
    problem,
    data: Epochs,
    *,
    period: float,
    n_quadrature: int = 600,
    degree: int = 6,
    **options,  # noqa: ARG001
):
    """Point (D,) -> epochs whose brightness is expanded about it; None for few points.

    A gradient then takes a sixth of the time, and ln posterior is wrong by less than half a nat (sd
    over the posterior of 43 Ariadne and of 135 Hertha), which the exact density corrects. Few
    points have cheap gradients, and wide posteriors, whose tails the expansion does not describe.
    """
    normals, harmonics, log_weights = grid(n_quadrature, degree)
    if data.t.size * len(normals) < MANY:
        return None
    shape = coordinates(data, n_quadrature=n_quadrature, degree=degree)["coefficients"]

    @jax.jit
    def about(z: jax.Array, information: jax.Array, epochs: Epochs) -> Epochs:
        axes = rotations.brought_to(asteroids.pole_of(problem.constrain(z, epochs)))

        def parts(z: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
            sites = problem.constrain(z, epochs)
            share = jax.nn.softmax(harmonics @ sites["coefficients"] + log_weights)
            motion = _motion(asteroids.pole_of(sites), sites["period_shift"], axes)
            return motion, asteroids.SPHERE * share, sites["lambert_c"]

        def light(motion: jax.Array, area: jax.Array, lambert: jax.Array) -> jax.Array:
            x, y, shift = motion
            pole = axes @ jnp.stack([x, y, jnp.ones(())])
            pole = pole / jnp.linalg.norm(pole)
            length = asteroids.period_s(epochs, period, shift)
            return _light(epochs, normals, pole, length, area, lambert)

        root = jnp.linalg.cholesky(information)
        along = solve_triangular(root, jax.jacrev(lambda z: parts(z)[0])(z).T, lower=True)
        widths = jnp.linalg.norm(along, axis=0)
        at, likely = parts(z), jax.lax.map(parts, likely_draws(z, root, LIKELY))
        # The coordinates of some draws may be those of no body.
        likely = jax.tree.map(lambda x, y: jnp.where(jnp.isfinite(x), x, y), likely, at)
        expansion = Expansion.of(light, at, likely, widths, axes, normals)
        start = shape.start(problem.unravel(z)["coefficients"])
        return replace(epochs, expansion=expansion._replace(start=start))

    return lambda z: about(jnp.asarray(z), compiled(problem.fisher)(z, data), data)


def shapes(data: Epochs, *, degree: int = 6, **options):  # noqa: ARG001
    """A sphere."""
    return [asteroids.light(data) | {"coefficients": jnp.zeros((degree + 1) ** 2 - 1)}]


def starts(data: Epochs, key, **options):  # noqa: ARG001
    """Spheres with poles over the whole sky and periods within the prior."""
    (sphere,) = shapes(data, **options)
    return [sphere | spin for spin in asteroids.spins()]


def coordinates(data: Epochs, *, n_quadrature: int = 600, degree: int = 6, **options):  # noqa: ARG001
    """Coordinates of the sampler: moments of the area fractions and c.

    The moments go up to degree 4, for which the data are informative; see `MomentCoordinates`. They
    are sums over the same normals as the brightness, since sums over other normals differ for
    angular bodies, and would change with coordinates that the data hardly constrain.

    c replaces ln c above the lower end of its prior. Brightness is linear in c, so the curve along
    which other parameters compensate for a change of c is five times straighter.
    """
    _, harmonics, log_weights = grid(n_quadrature, degree)
    low = min(degree, MOMENT_DEGREE)
    return {
        "coefficients": MomentCoordinates(harmonics, (low + 1) ** 2 - 1, log_weights),
        "log_lambert_c": asteroids.LINEAR_LAMBERT,
    }


def constants(data: Epochs, *, n_facets: int = 300, **options):  # noqa: ARG001
    """The grid: normals (N, 3)."""
    return {"grid_normals": facets.rings(n_facets)[0]}
