"""Facets of a satellite with a known attitude law, so that the attitude is not inferred."""

from functools import partial
from typing import Literal

import numpy as np
import numpyro
import numpyro.distributions as dist

from lcbayes.core.constants import EARTH_RADIUS_KM
from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.modelling import likelihood, nuisances, priors
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.facet_list import ARRAY, facet_list
from lcbayes.physics import brightness, earthshine, photometry
from lcbayes.physics.attitude import catalogue, rotations
from lcbayes.physics.attitude.laws import Ephemeris
from lcbayes.physics.bodies import facets as directions
from lcbayes.physics.reflectance import LAWS, SatelliteLaw

SUMMARY = "facets of known, partly known or unknown normals on a satellite of known attitude"
UNIT = {"r_diff": 1.0, "r_spec": 1.0, "w": 4.0 * np.pi}  # for which area equals albedo-area
SPECULAR = {"nu": (30.0, 1.0), "n": (30.0, 1.0), "m": (0.3, 0.7)}
HELD, FREE = "_held", "_free"  # suffixes of the site names of listed and other facets
FACET_SITES = (
    "free_normals_base",
    *(
        name + FREE
        for name in ("log_albedo_area", "r_sum", "specular_share", "log_nu", "log_n", "log_m")
    ),
)

POOLED = {"individuals": False, "clock_sd": 0.0}  # during the search for solutions
NUM_STARTS = 400  # for three facets on Pomenis 1 in 60 reached the best; many individuals are slow


def model(
    data: Epochs,
    *,
    law: str = "yaw-steering",
    n_facets: int = 0,
    facets: str = "",
    reflectance: Literal[SatelliteLaw, "lommel-seeliger-lambert"] = "ashikhmin-shirley",
    surface: Literal["separate", "shared"] = "separate",
    individuals: bool = True,
    site_offsets: bool = True,
    passes: bool = True,
    extinction: bool = False,
    earth_albedo: float = 0.0,
    log_area_mean: float = 0.0,
    log_area_sd: float = 1.5,
    noise_law: likelihood.Law = "student-t",
    scatter: float = 0.3,
    clock_sd: float = 0.0,
):
    """f(t) = Σ Aᵢ f_rᵢ μ₀ᵢ μᵢ for facets in the axes of an attitude law.

    Parameters
    ----------
    law
        Attitude law with its settings, e.g. lvlh:yaw_deg=4. The default has z at nadir, and x as
        close as possible to the Sun.
    n_facets
        Total number of facets; facets not listed have unknown normals. 0: those listed, or two.
    facets
        Facets with known normals, e.g. +z, array:+x~5@22.7, sun-pointing:-x, 0 0.6 0.8 — in the
        axes of the body, of its array or of another law; ~ uncertainty in degrees; @ area in m².
    reflectance
        Reflectance law of all facets; see `lcbayes.physics.reflectance`.
    surface
        Parameters of the reflectance: "separate" for each facet, or "shared".
    individuals
        Whether the curves (satellites), if several, have different mean brightness.
    site_offsets
        Whether the magnitudes of each site, if several, have a separate zero point.
    passes
        Whether part of the model error is common to the points of a pass, for several curves of
        several passes.
    extinction
        Whether the magnitudes include atmospheric extinction; k ~ Normal(0.2, 0.1) mag/airmass.
    earth_albedo
        Albedo of the ground, which also illuminates the satellite; 0: no earthshine.
    log_area_mean, log_area_sd
        Mean and sd of ln(α / m²), α = area · (r_diff + r_spec) or area · w/4π, of facets of
        unknown area.
    noise_law
        gaussian, student-t or mixture.
    scatter
        Median of the prior of the scatter in excess of the file's errors, mag; 0: no such scatter.
    clock_sd
        Prior sd of the offset of each observer's clock, if several, s; 0: all exact. Only the
        directions to Sun and observer depend on the clock.
    """
    data = nuisances.moved(data, nuisances.late(data, nuisances.clock_offsets(data, clock_sd)))
    listed = facet_list(facets)
    total = n_facets or len(listed) or 2
    if total < len(listed):
        raise InputError(f"n_facets is {n_facets}, but {len(listed)} facets are listed")
    free = total - len(listed)

    where = [facet.where for facet in listed] + [""] * free
    normals = _normals(listed, free)
    area, parameters = _surface(listed, free, reflectance, surface, (log_area_mean, log_area_sd))
    turned = {name: _law(law, name) for name in sorted(set(where))}

    def at(t):
        along = data.orbit._replace(t=t)
        toward, strength = _illumination(data, along, earth_albedo)
        flux = jnp.zeros(t.shape)
        for name, attitude_law in turned.items():
            here = jnp.array([i for i, other in enumerate(where) if other == name])
            made = attitude_law.frames(along)
            axes = jnp.asarray(made.array if name == ARRAY else made.body)
            mine = {k: jnp.broadcast_to(v, (total,))[here] for k, v in parameters.items()}
            reflected = partial(
                brightness.flux_brdf,
                obs_body=rotations.to_body(axes, data.obs),
                normals=normals[here],
                area=area[here],
                law=reflectance,
                params=mine,
            )
            each = jax.vmap(lambda v, axes=axes, f=reflected: f(rotations.to_body(axes, v)))(toward)
            flux += jnp.sum(strength * each, axis=0)
        return flux

    if free:
        axes = _law(law, "").frames(data.orbit).body
        sun, obs = rotations.to_body(axes, data.sun), rotations.to_body(axes, data.obs)
        priors.visibility_prior(sun, obs, normals[len(listed) :])
    flux = (photometry.exposed(at, data.exposure_s) if data.has_exposure else at)(data.t)
    dimmed = flux * 10.0 ** (-0.4 * _fainter(data, individuals, site_offsets, extinction))
    likelihood.observe(
        data, dimmed, noise_law, scatter, passes and data.has_passes and data.calibrated
    )


def _illumination(data: Epochs, orbit: Ephemeris, earth_albedo: float):
    """Unit vectors towards what illuminates the satellite, (K, T, 3), and its irradiance in units
    of the Sun's, (K, T): the Sun, and patches of the Earth if its albedo is not zero."""
    toward, strength = data.sun[None], jnp.ones((1, *orbit.t.shape))
    if earth_albedo:
        if orbit.position_km is None:
            raise InputError("earth_albedo is given, but the satellite's places are not known")
        shine = earthshine.glow(orbit.position_km / EARTH_RADIUS_KM, data.sun, earth_albedo)
        toward = jnp.concatenate([toward, shine.toward])
        strength = jnp.concatenate([strength, shine.strength / data.sunlight])
    return toward, strength


def _fainter(data: Epochs, individuals: bool, site_offsets: bool, extinction: bool):
    """Magnitudes by which each point is fainter than the body, (T,)."""
    fainter = jnp.zeros(data.t.shape)
    if individuals and data.n_members > 1 and data.calibrated:
        fainter += priors.deviations("member", data.n_members, 0.2)[data.member]
    if site_offsets and data.n_sites > 1:
        fainter += priors.deviations("site", data.n_sites, 0.2)[data.site]
    if extinction:
        fainter += numpyro.sample("extinction", dist.Normal(0.2, 0.1)) * data.airmass
    return fainter


def _law(law: str, where: str):
    """The attitude law that defines the axes of facets."""
    if where not in ("", ARRAY):
        return catalogue.parse(where)
    parsed = catalogue.parse(law)
    if where == ARRAY and not parsed.array:
        raise InputError(f"a facet is on the array, but the law {law!r} has none")
    return parsed


def _normals(listed, free: int):
    """Unit normals (N, 3), the listed ones first."""
    known = jnp.array([facet.normal for facet in listed]).reshape(-1, 3)
    partly = [i for i, facet in enumerate(listed) if facet.sd_deg]
    if partly:
        width = jnp.deg2rad(jnp.array([listed[i].sd_deg for i in partly]))
        unit = dist.Normal(0.0, 1.0).expand([len(partly), 2]).to_event(2)
        tilt = width[:, None] * numpyro.sample("tilt_unit", unit)
        axes = directions.across([listed[i].normal for i in partly])
        across = jnp.asarray(np.stack(axes, axis=1))  # (P, 2, 3)
        tilted = known[jnp.array(partly)] + jnp.einsum("pk,pkx->px", jnp.tan(tilt), across)
        tilted = tilted / jnp.linalg.norm(tilted, axis=1, keepdims=True)
        known = known.at[jnp.array(partly)].set(tilted)
    anywhere = priors.directions("free_normals", free) if free else jnp.zeros((0, 3))
    normals = jnp.asarray(numpyro.deterministic("normals", jnp.concatenate([known, anywhere])))
    phi, g = directions.angles(normals)
    numpyro.deterministic("phi", phi)
    numpyro.deterministic("g", g)
    return normals


def _surface(listed, free: int, reflectance: str, kind: str, log_area: tuple[float, float]):
    """Area of each facet (N,) and the parameters of its reflectance, (N,) or (1,) if shared."""
    law = LAWS[reflectance]
    parts = [k for k in UNIT if k in law.parameters]  # of the reflected light
    known = {k: p.default for k, p in law.parameters.items() if p.default is not None}
    known |= {k: UNIT[k] for k in parts if law.diffuse}
    parameters = {k: jnp.atleast_1d(jnp.asarray(v)) for k, v in known.items()}
    unknown = [i for i, facet in enumerate(listed) if facet.area_m2 is None]
    if not law.diffuse or len(unknown) < len(listed):
        if kind == "shared":
            drawn = priors.surface(reflectance, 1, SPECULAR, "_shared")
        else:
            each = [
                priors.surface(reflectance, n, SPECULAR, suffix)
                for n, suffix in ((len(listed), HELD), (free, FREE))
                if n
            ]
            drawn = {k: jnp.concatenate([one[k] for one in each]) for k in each[0]}
        parameters |= drawn
        for name, values in drawn.items():
            numpyro.deterministic(name, values)
    share = sum((parameters[k] / UNIT[k] for k in parts), jnp.zeros(1))

    # The data constrain the albedo-area; if the area is given, it is area times reflectance.
    albedo_area = share * jnp.array([facet.area_m2 or 1.0 for facet in listed] + [1.0] * free)
    for which, suffix in ((unknown, HELD), (list(range(len(listed), len(listed) + free)), FREE)):
        if which:
            sizes = priors.log_normal(f"albedo_area{suffix}", len(which), *log_area)
            albedo_area = albedo_area.at[jnp.array(which)].set(sizes)
    numpyro.deterministic("albedo_area", albedo_area)
    area = jnp.asarray(numpyro.deterministic("area", albedo_area / share))
    return area, parameters
