"""N diffuse facets at a constant rate of rotation, or tumbling (Linares & Crassidis, eqs. 4-9)."""

from typing import Literal

import numpyro

from lcbayes.modelling import likelihood, nuisances, nutation, priors, zero_points
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.known_spin import KnownSpin
from lcbayes.modelling.problem import Coordinates, Problem
from lcbayes.modelling.spin_coordinates import rate_and_direction
from lcbayes.physics import brightness
from lcbayes.samplers.facet_moves import FacetMoves

FACET_SITES = ("normals_base", "log_albedo_area")
SUMMARY = "N diffuse facets, constant rate or torque-free: albedo-areas, normals, omega"

MOVED_FACETS = 3  # from this number on, facets have arrangements that chains may miss

POOLED = nuisances.UNMODELLED  # during the search for solutions
KEPT = ("clock_sd", "rate_drift_sd")


def model(
    data: Epochs,
    *,
    n_facets: int = 2,
    spin: Literal["free", "none", "torque-free"] = "free",
    omega_sd: float = 0.1,
    period: str = "",
    pole: str = "",
    inertia_sd: float = 1.0,
    reflectance: brightness.DiffuseLaw = "non-lambertian",
    log_area_mean: float = 0.0,
    log_area_sd: float = 1.0,
    sparsity: float = 0.0,
    noise_law: likelihood.Law = "gaussian",
    scatter: float = 0.0,
    correlated_noise: bool = False,
    zero_point_sd: float = zero_points.SD,
    zero_point_spread: float = zero_points.SPREAD,
    clock_sd: float = nuisances.CLOCK_SD,
    rate_drift_sd: float = nuisances.RATE_DRIFT_SD,
    nutation_sd: float = nutation.SD_DEG,
    nutation_ratio: float = 0.0,
):
    """Flux f(t) = Σ αᵢ K(μ₀ᵢ, μᵢ) with α log-normal, normals uniform, ω ~ N(0, omega_sd² I).

    What is known of the spin (``period``, ``pole``) replaces the prior of ω's size or direction:
    see `modelling.known_spin`.

    Parameters
    ----------
    n_facets
        Number of facets N.
    spin
        "free": constant ω is inferred; "none": the body does not rotate (ω = 0); "torque-free": ω
        and the inertia tensor of a rigid body without torque are inferred.
    omega_sd
        Prior standard deviation of each component of ω, rad/s; of a torque-free body, in the middle
        of the light curve.
    period
        Sidereal period as far as it is known, with a unit: 23.7s, 23.70+-0.02s, 20-30s, or several.
    pole
        Region of the pole or its opposite, RA,DEC,RADIUS, deg, in the axes of the light curve.
    inertia_sd
        Elongation of a torque-free body; 1: a box is 2.1 to 9.9 times as long as thin (90 %).
    reflectance
        Reflectance: non-lambertian, lambertian or lommel-seeliger-lambert.
    log_area_mean, log_area_sd
        Mean and sd of ln(α / m²).
    sparsity
        Weight of the squared-L1 prior on the albedo-areas, m⁻⁴; 0: no such prior.
    noise_law
        gaussian, student-t or mixture.
    scatter
        Median of the prior of the scatter in excess of the file's errors, mag or relative; 0: none.
    correlated_noise
        Whether the noise includes an Ornstein-Uhlenbeck process of unknown size and time scale.
    zero_point_sd
        Prior sd of the zero point of each observer and night, if several, mag; 0: all equal.
    zero_point_spread
        Prior sd of ln(sd of the zero points), of which zero_point_sd is the median; 0: known.
    clock_sd
        Prior sd of the offset of each observer's clock, if several, s; 0: all exact.
    rate_drift_sd
        Prior sd of the relative change of rate over the light curve, if it has several passes; ω is
        then the mean; 0: constant.
    nutation_sd
        Prior sd of each of four components of small nutation about a constant ω, deg; 0: none.
    nutation_ratio
        Nutation frequency over the rate of rotation, below 1; 0: no nutation.
    """
    known = KnownSpin.of(period, pole)
    turned = nuisances.rotation(data, spin, omega_sd, inertia_sd, clock_sd, rate_drift_sd, known)
    normals = priors.normals(n_facets, turned.start)
    area = priors.albedo_area(n_facets, log_area_mean, log_area_sd)
    if sparsity:
        priors.sparse_area(area, sparsity)

    def seen(sun, obs):
        return brightness.flux(sun, obs, normals, area, reflectance)

    sun, obs = turned(data.t, data.sun, data.obs)
    numpyro.deterministic("sun_body", sun)
    numpyro.deterministic("obs_body", obs)
    priors.visibility_prior(sun, obs, normals)
    mean, wobble = nuisances.expected(data, turned, seen, spin, nutation_sd, nutation_ratio)
    zero_point = zero_points.Prior(zero_point_sd, zero_point_spread)
    likelihood.observe(data, mean, noise_law, scatter, False, zero_point, correlated_noise, wobble)


def coordinates(
    data: Epochs,
    *,
    spin: str = "free",
    omega_sd: float = 0.1,
    period: str = "",
    clock_sd: float = nuisances.CLOCK_SD,
    **options: object,  # noqa: ARG001
) -> Coordinates | None:
    """Coordinates of the sampler: rate and direction of ω, if the body may turn many times, and
    differences of clocks."""
    motion = rate_and_direction(spin, omega_sd, period, float(data.t_span)) or {}
    clocks = {} if spin == "none" else nuisances.clock_coordinates(data, clock_sd)
    return {**motion, **clocks} or None


def moves(
    problem: Problem,
    data: Epochs,
    *,
    n_facets: int = 2,
    spin: str = "free",
    reflectance: brightness.DiffuseLaw = "non-lambertian",
    log_area_mean: float = 0.0,
    log_area_sd: float = 1.0,
    zero_point_sd: float = zero_points.SD,
    superfluous: bool = False,
    **options: object,  # noqa: ARG001
) -> FacetMoves | None:
    """Moves of single facets of a spinning body of several, to test whether chains missed any, or
    of any body of several if some of them may be ``superfluous``."""
    if n_facets < 2 or not (superfluous or (spin != "none" and n_facets >= MOVED_FACETS)):
        return None
    return FacetMoves.of(problem, data, reflectance, log_area_mean, log_area_sd, zero_point_sd)
