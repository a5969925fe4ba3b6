"""N facets, each with its own reflectance, at a constant rate of rotation, or tumbling."""

from typing import Literal

import numpyro
import numpyro.distributions as dist

from lcbayes import noise, priors
from lcbayes._jax import jnp
from lcbayes.epochs import Epochs
from lcbayes.physics import brightness, photometry, reflectance

SUMMARY = "N facets with diffuse and specular parts of their own, constant rate or torque-free"

# Priors of the parameters that are scales: median and sd of the logarithm.
SCALES = {"nu": (100.0, 1.0), "n": (100.0, 1.0), "m": (0.2, 0.5)}
FACET_SITES = ("normals_base", "log_albedo_area", "r_diff", "r_spec", "w", "log_nu", "log_n",
               "log_m")  # fmt: skip


def surface(law: str, n_facets: int) -> dict[str, jnp.ndarray]:
    """The parameters of each facet's law, (N,) each: shares uniform, scales log-normal."""
    found = {}
    for name, parameter in reflectance.get_law(law).parameters.items():
        if name == "nv":  # the in-plane axis of an unknown facet is not observable enough to ask
            continue
        if name in SCALES:
            median, sd = SCALES[name]
            log = dist.Normal(jnp.log(median), sd).expand([n_facets]).to_event(1)
            log_value = numpyro.sample(f"log_{name}", log)
            found[name] = numpyro.deterministic(name, jnp.exp(log_value))
        elif parameter.default is None:
            uniform = dist.Uniform(parameter.lower, parameter.upper).expand([n_facets])
            found[name] = numpyro.sample(name, uniform.to_event(1))
    return found


def model(
    data: Epochs,
    *,
    n_facets: int = 2,
    law: Literal[
        "ashikhmin-shirley",
        "ashikhmin-shirley-distribution",
        "cook-torrance",
        "blinn-phong",
        "lambertian",
        "non-lambertian",
    ] = "ashikhmin-shirley",
    spin: Literal["free", "none", "torque-free"] = "free",
    omega_sd: float = 0.1,
    inertia_sd: float = 1.0,
    log_area_mean: float = 0.0,
    log_area_sd: float = 1.0,
    sparsity: float = 0.0,
    noise_law: noise.Law = "gaussian",
):
    """f(t) = Σ Aᵢ f_rᵢ μ₀ᵢ μᵢ, with f_r of the law named and A = α / (sum of the reflectances).

    What the data fix is the albedo-area α; how it divides into area and reflectance is left to
    the priors. Facets are isotropic. Linares & Crassidis, sec. VII.D and table 1 as corrected.

    Parameters
    ----------
    n_facets
        Number of facets N.
    law
        ashikhmin-shirley (denominator c·max(μ₀, μ)), ashikhmin-shirley-distribution
        (μ₀ + μ − μ₀μ), cook-torrance, blinn-phong, or a diffuse law.
    spin
        "free": constant ω is inferred; "none": the body does not turn (ω = 0); "torque-free": ω
        at t = 0 and the inertia tensor of a rigid body without torque.
    omega_sd
        Prior standard deviation of each component of ω, rad/s.
    inertia_sd
        How uneven a torque-free body is; 1: a box is 2.1 to 9.9 times as long as thin (90 %).
    log_area_mean, log_area_sd
        Mean and sd of ln(α / m²).
    sparsity
        Weight of the squared-L1 prior on the albedo-areas, m⁻⁴; 0 leaves it out.
    noise_law
        gaussian or student-t.
    """
    turned = priors.spin(spin, omega_sd, inertia_sd)
    normals = priors.normals(n_facets)
    albedo_area = priors.albedo_area(n_facets, log_area_mean, log_area_sd)
    if sparsity:
        priors.sparse_area(albedo_area, sparsity)
    parameters = surface(law, n_facets)
    shares = [parameters[k] for k in ("r_diff", "r_spec", "w") if k in parameters]
    if reflectance.get_law(law).sum_to_one:
        # Beyond a sum of one the facet would give back more light than it receives.
        numpyro.factor("energy", -50.0 * jnp.sum(jnp.maximum(sum(shares) - 1.0, 0.0)))
    area = numpyro.deterministic("area", albedo_area / sum(shares))

    def directions(t):
        return turned(t, data.sun, data.obs)

    def instantaneous(t):
        return brightness.flux_brdf(*directions(t), normals, area, law, parameters)

    sun, obs = directions(data.t)
    priors.lit_and_seen(sun, obs, normals)
    mean = photometry.exposed(instantaneous, data.exposure_s)
    noise.observe(data, (mean if data.has_exposure else instantaneous)(data.t), noise_law)
