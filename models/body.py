"""A body of known parts (box, cylinder, plate …) whose motion and surface are unknown."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from inspect import signature
from typing import Literal

import numpy as np
import numpyro
import numpyro.distributions as dist
from numpyro import handlers
from scipy.spatial.transform import Rotation

from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.inference import body_symmetry
from lcbayes.inference.body_search import cells, phases, turns
from lcbayes.inference.body_search.surface import Surface
from lcbayes.inference.label_switching import AttitudeOrder
from lcbayes.inference.spin_search.allowed import Allowed
from lcbayes.inference.spin_search.drift import Drift
from lcbayes.modelling import body_expansion, body_motion, likelihood, nuisances, zero_points
from lcbayes.modelling.constrained import over_draws
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.expansion import likely_draws
from lcbayes.modelling.known_spin import MIN_BISECTOR, KnownSpin, RatePrior
from lcbayes.modelling.problem import (
    LIT,
    OBS,
    SUN,
    TRACING,
    Coordinates,
    Problem,
    compiled,
    shaded,
    with_lit,
)
from lcbayes.modelling.spin_coordinates import rate_and_direction
from lcbayes.modelling.variables import albedo_area
from lcbayes.physics import photometry
from lcbayes.physics.bodies.lit import Lit
from lcbayes.simulation.known_bodies import reflectances
from lcbayes.simulation.known_bodies.body import KnownBody
from lcbayes.simulation.known_bodies.reader import (
    BodyFile,
    Prior,
    body_text,
    read_body_text,
    with_shadows,
)

SUMMARY = "a body of known parts, constant rate: attitude, omega, surface, scale"

STILL_DEG = 15.0  # of the bisector, from its mean, below which the turn about it is a coordinate
SLOW_SHADOWS = 5.0  # times as long, from which on the search has none
MANY = 5_000  # epochs × panels × cost of shadows, from which on chains follow an expansion
MOST_OBSERVERS = 20  # of an expansion, as the clock of each is a variable
ROUGH = 0.02  # tolerance of the body of such a search
# during the search for solutions
POOLED = {"zero_point_spread": 0.0, "clock_sd": 0.0, "rate_drift_sd": 0.0}
KEPT = ("clock_sd", "rate_drift_sd")
# while each arc has a phase of its own
SEARCHED = {
    "zero_point_sd": 0.0,
    "rate_drift_sd": 0.0,
    "correlated_noise": False,
    "noise_law": "gaussian",
    "period": "",
}


def model(
    data: Epochs,
    *,
    body: str,
    spin: Literal["flat", "free"] = "flat",
    omega_sd: float = 0.1,
    period: str = "",
    shadows: bool = True,
    tolerance: float = 0.0,
    scale_sd: float = 0.5,
    noise_law: likelihood.Law = "gaussian",
    scatter: float = 0.0,
    correlated_noise: bool = False,
    zero_point_sd: float = zero_points.SD,
    zero_point_spread: float = zero_points.SPREAD,
    clock_sd: float = nuisances.CLOCK_SD,
    rate_drift_sd: float = nuisances.RATE_DRIFT_SD,
):
    """f(t) = κ Σ Aᵢ vᵢ f_rᵢ μ₀ᵢ μᵢ of a given body, ω constant, the attitude at t = 0 uniform.

    Parameters
    ----------
    body
        Name of a bundled body, or TOML file; see docs/bodies.md.
    spin
        "flat": about the principal axis of largest inertia of the body, or its spin_axis; "free":
        about any axis. For a body with an axis of symmetry, "free" is its torque-free motion: ω is
        the rate at which the axis goes round the angular momentum.
    omega_sd
        Prior standard deviation of each component of ω, or of the rate of a flat spin, rad/s.
    period
        Sidereal period as far as it is known, with a unit: 23.7s, 23.70+-0.02s, 20-30s, or several.
    shadows
        Whether the parts shade and hide one another, if the body's file says so.
    tolerance
        Of the flux of curved parts, over its maximum; 0: that of the body's file.
    scale_sd
        Prior sd of ln κ, if the brightness is calibrated; 0: κ = 1, the body is as large and bright
        as the file says.
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
    """
    file = _file(body, spin, shadows, tolerance)
    known = file.body
    motion = _motion(data, known, spin, omega_sd, clock_sd, rate_drift_sd, period)
    turned = motion.turned(data)
    values = {name: _surface(file, name) for name in known.materials}
    sizes = {
        (i, key): _drawn(f"{known.names[i]}_{key}", prior) for (i, key), prior in file.sizes.items()
    }
    areas = reflectances.albedo_areas(file, values)
    total = sum(areas.values())
    size = _size(total, scale_sd) if data.calibrated and scale_sd else jnp.ones(())
    for name, area in areas.items():
        numpyro.deterministic(albedo_area(name), size * area)

    sun, obs = turned(data.t)
    numpyro.deterministic(SUN, sun)
    numpyro.deterministic(OBS, obs)
    if isinstance(data.expansion, body_expansion.BodyExpansion):
        near = _near(motion, data.expansion.middle, known, spin)
        shape = reflectances.shape_of(file, values, sizes)
        weights = reflectances.weights(file, values)
        flux = data.expansion(jnp.concatenate([near, shape]), weights)
    else:
        lit = None
        if data.lit is not None:
            lit = data.lit(sun, obs)
        elif shadows and (lit := known.assembly.lit_and_seen(sun, obs)) is not None:
            numpyro.deterministic(LIT, lit)
        flux = _light(data, known, turned, values, sizes, shadows, lit)
    zero_point = zero_points.Prior(zero_point_sd, zero_point_spread)
    likelihood.observe(data, size * flux, noise_law, scatter, False, zero_point, correlated_noise)


def _light(
    data: Epochs,
    known: KnownBody,
    turned: body_motion.Turned,
    values,
    sizes,
    shadows: bool,
    lit: jax.Array | None,
) -> jax.Array:
    """Flux (T,) of a body of the size of its file; ``lit`` is that of instantaneous points."""
    if not data.has_exposure:
        return known.flux(*turned(data.t), values, shadows, sizes, lit)

    def seen(t):
        to_sun, to_obs = turned(t)
        given = None if data.lit is None else data.lit(to_sun, to_obs)
        return known.flux(to_sun, to_obs, values, shadows, sizes, given)

    return photometry.exposed(seen, data.exposure_s)(data.t)


def _near(motion: body_motion.Motion, middle, known: KnownBody, spin: str) -> jax.Array:
    """Coordinates of a motion about the attitude ``middle``, without redundant ones."""
    if spin == "flat":
        return motion.near(middle, known.flat_axis, None)
    return motion.near(middle, None, known.symmetry.axis)


def _motion(
    data: Epochs,
    known: KnownBody,
    spin: str,
    omega_sd: float,
    clock_sd: float,
    rate_drift_sd: float,
    period: str = "",
) -> body_motion.Motion:
    given = KnownSpin.of(period)
    prior = None if given is None else given.prior(omega_sd, data)
    if spin == "flat":
        along = None if prior is None else RatePrior(prior)
        attitude, omega = body_motion.flat_spin(known.flat_axis, omega_sd, along)
    else:
        attitude, omega = body_motion.free_spin(known.symmetry.axis, omega_sd, prior)
    return body_motion.Motion.of(data, attitude, omega, clock_sd, rate_drift_sd)


def _file(body: str, spin: str, shadows: bool, tolerance: float = 0.0) -> BodyFile:
    """The body, if its motion can be seen and its shadows have a derivative."""
    file = read_body_text(body_text(body), tolerance or None)
    symmetry = file.body.symmetry
    if symmetry.sphere:
        raise InputError(
            "the brightness of this body is the same in every attitude, so that no motion can be "
            "inferred; give a body that is not a uniform sphere"
        )
    along = symmetry.axis
    if spin == "flat" and along is not None and abs(along @ file.body.flat_axis) > 1.0 - 1e-6:
        raise InputError(
            "the body is symmetric about the axis of its flat spin, so that this rotation cannot "
            "be seen; choose --spin free, or give spin_axis in [body]"
        )
    if shadows and file.body.assembly.method == "points":
        raise InputError(
            "the body has too many faces that shade one another for exact shadows, and others have "
            "no derivative; leave out small parts, raise body.tolerance, or --set shadows=false"
        )
    return file


def _surface(file: BodyFile, material: str):
    """Parameters of a material, the unknown ones drawn from their priors."""
    return {k: _drawn(f"{material}_{k}", prior) for k, prior in file.priors[material].items()}


def _drawn(name: str, prior: Prior):
    if prior.kind == "uniform":
        return jnp.asarray(numpyro.sample(name, dist.Uniform(prior.first, prior.second)))
    law = dist.Normal(np.log(prior.first), np.log(prior.second))
    value = jnp.exp(jnp.asarray(numpyro.sample(f"log_{name}", law)))
    return jnp.asarray(numpyro.deterministic(name, value))


def _size(albedo_area, scale_sd: float):
    """κ, log-normal about 1.

    The sampled site is ln κ of the total albedo-area: the data fix that, and κ and the reflectances
    alone hardly.
    """
    law = dist.Normal(jnp.log(albedo_area), scale_sd)
    total = jnp.asarray(numpyro.sample("log_brightness", law))
    return jnp.asarray(numpyro.deterministic("size", jnp.exp(total) / albedo_area))


def resolved(options):
    """The options with the text of the body in place of its name or file."""
    return {**options, "body": body_text(options["body"])}


def _motion_at(sites, epochs: Epochs, file: BodyFile, options) -> body_motion.Motion:
    """The motion for given values of all sites."""
    defaults = signature(model).parameters
    names = ("spin", "omega_sd", "clock_sd", "rate_drift_sd", "period")
    given = {name: options.get(name, defaults[name].default) for name in names}
    with TRACING, handlers.block(), handlers.substitute(data=dict(sites)):
        return _motion(epochs, file.body, **given)


def shadows_left_out(
    draws: Sequence[Mapping[str, jax.Array]], data: Epochs, **options
) -> np.ndarray | None:
    """Changes of the flux by the shadows of a body that is fitted without them, (n, T).

    Parameters
    ----------
    draws : sequence of n {site: value}
        Constrained values of all sites. Unknown lengths have those of the first.

    Returns
    -------
    (n, T) or None
        None if the fit has the shadows, or no part can shade another.
    """
    file = read_body_text(options["body"])
    if options.get("shadows", True) and file.body.assembly.shaded:
        return None
    sizes = {key: float(length) for key, length in _lengths(draws[0], file).items()}
    full = with_shadows(options["body"], sizes)
    if full.assembly.method == "none":
        return None

    @jax.jit
    def change(sites: Mapping[str, jax.Array], epochs: Epochs) -> jax.Array:
        turned = _motion_at(sites, epochs, file, options).turned(epochs)
        values = _values(sites, file)

        def taken(t: jax.Array) -> jax.Array:
            seen = turned(t)
            lit = (full.flux(*seen, values, every) for every in (True, False))
            return sites.get("size", 1.0) * (next(lit) - next(lit))

        exposed = photometry.exposed(taken, epochs.exposure_s) if epochs.has_exposure else taken
        return exposed(epochs.t)

    return np.stack([np.asarray(change(sites, data)) for sites in draws])


def coordinates(
    data: Epochs,
    *,
    body: str,
    spin: str = "flat",
    omega_sd: float = 0.1,
    period: str = "",
    scale_sd: float = 0.5,
    clock_sd: float = nuisances.CLOCK_SD,
    **options: object,  # noqa: ARG001
) -> Coordinates | None:
    """Coordinates of the sampler: rate and direction of ω, if the body may turn many times; of a
    flat spin the turn about the bisector, if that hardly moves; offsets of clocks; logarithms of
    size and surface.
    """
    file = read_body_text(body)
    others = {
        **reflectances.coordinates_of(file, scale_sd if data.calibrated else None),
        **nuisances.clock_coordinates(data, clock_sd),
    }
    if spin == "free":
        motion = rate_and_direction(spin, omega_sd, period, float(data.t_span)) or {}
        return {**motion, **others} or None
    both = np.asarray(data.sun) + np.asarray(data.obs)
    size = np.linalg.norm(both, axis=1)
    if size.min() >= MIN_BISECTOR:
        mean = (both / size[:, None]).mean(axis=0)
        nearest = float((both @ mean / size).min() / np.linalg.norm(mean))
        if nearest >= np.cos(np.deg2rad(STILL_DEG)):
            return {"attitude_base": body_motion.TurnAboutBisector(mean), **others}
    return others or None


def search(problem, data: Epochs, options, workers: int, progress, checkpoint=None):  # noqa: ARG001
    """All motions that the prior allows; see `lcbayes.inference.body_search`."""
    file = _file(options["body"], options["spin"], options["shadows"], float(options["tolerance"]))
    known, allowed = file.body, Allowed.of(options, data)
    symmetry = known.symmetry
    flat = known.flat_axis if options["spin"] == "flat" else None
    directions = cells.directions_of(flat, symmetry.axis, symmetry.rotations)
    many = {"most": 1} if len(directions) > cells.MANY_AXES else {}
    tolerance = max(ROUGH, known.assembly.tolerance)
    coarse = read_body_text(body_text(options["body"]), tolerance)
    surface = Surface.of(coarse, data.sun, data.obs, **many)
    run = cells.MotionSearch.of(data, surface, directions, allowed)
    run, best, coverage = cells.visited(run, workers, progress)
    unit = 1.0 if data.calibrated else run.scale
    apart = phases.Separate.of(run, unit)
    starts = phases.starts(run, best)
    sites = [
        _start(start, file, surface, options, unit) | apart.offsets(start.late) for start in starts
    ]
    loose = options | POOLED | SEARCHED | {"clock_sd": apart.clock_sd}
    if not data.calibrated:
        loose["scale_sd"] = cells.CALIBRATED_SD
    bare = replace(known, assembly=replace(known.assembly, shaded=False))
    any_shadows = options["shadows"] and known.assembly.method != "none"
    blind = symmetry.axis is None and bare.symmetry.axis is not None
    exact = any_shadows and (known.assembly.shadow_cost < SLOW_SHADOWS or blind)
    rough = {"shadows": False, "tolerance": tolerance}
    simple = Problem(partial(model, **loose | rough), apart.soft)
    # Without shadows, attitudes may be equivalent that are not so with them.
    alike = body_symmetry.equivalents(bare, options["spin"], (1.0,))
    if len(bare.symmetry.rotations) == len(symmetry.rotations) and not blind:
        alike = alike[:1]
    cell = np.array([start.cell for start in starts])
    ends = phases.optimised(simple, apart, sites, cell, workers, progress)
    if exact:
        images = AttitudeOrder(simple, alike).images
        simple = Problem(partial(model, **loose), apart.soft, shading=known.assembly.shading)
        ends = phases.with_shadows(simple, apart, ends, images, workers, progress)
    ends = phases.followed(simple, apart, ends, workers, progress)
    drift = Drift.of(data, problem, float(options["rate_drift_sd"]))
    joined = turns.starts(simple, apart, ends, allowed, drift)
    if exact or problem.shading is None:
        return turns.optimised(problem, data, joined, workers, progress), coverage
    simple = Problem(partial(model, **options | rough), data)
    ends = turns.optimised(simple, data, joined, workers, progress)
    images = AttitudeOrder(problem, alike).images
    return turns.with_fixed_shadows(problem, data, ends, images, workers, progress), coverage


def _start(start: phases.Start, file: BodyFile, surface: Surface, options, unit: float):
    """The sites of a start of the search, for a flux in a unit (m²)."""
    values = surface.values(start.coefficients)
    sites = surface.sites(values)
    known, omega_sd = file.body, float(options["omega_sd"])
    if options["spin"] == "flat":
        sites["rate_unit"] = start.omega @ start.attitude @ known.flat_axis / omega_sd
    else:
        sites["omega_unit"] = start.omega / omega_sd
    if options["spin"] == "free" and known.symmetry.axis is not None:
        sites["axis_base"] = (start.attitude @ known.symmetry.axis)[None]
    else:
        quaternion = Rotation.from_matrix(start.attitude).as_quat(scalar_first=True)
        sites["attitude_base"] = quaternion
    every = {name: values.get(name, {}) for name in known.materials}
    scale = max(start.coefficients[0], 1e-6) / unit
    sites["log_brightness"] = np.log(
        scale * float(sum(reflectances.albedo_areas(file, every).values()))
    )
    return sites


def guide(problem, data: Epochs, **options):
    """Point (D,) -> epochs whose brightness is expanded about it; None if a gradient is cheap."""
    spin, shadows = options.get("spin", "flat"), options.get("shadows", True)
    file = _file(options["body"], spin, shadows, float(options.get("tolerance", 0.0)))
    known = file.body
    cost = known.assembly.shadow_cost if shadows else 1.0
    cheap = data.t.size * known.assembly.body.areas.size * cost < MANY
    if cheap or data.n_observers > MOST_OBSERVERS:
        return None
    ends = reflectances.corners(file)

    def parts(middle, z, epochs: Epochs) -> tuple[jax.Array, jax.Array, jax.Array]:
        sites = problem.constrain(z, epochs)
        values, sizes = _values(sites, file), _lengths(sites, file)
        motion = _motion_at(sites, epochs, file, options)
        turned = motion.turned(epochs)
        lit = None if epochs.lit is None else epochs.lit(*turned(epochs.t))

        def seen(end) -> jax.Array:
            given = {name: {**values[name], **end.get(name, {})} for name in values}
            return _light(epochs, known, turned, given, sizes, shadows, lit)

        shape = reflectances.shape_of(file, values, sizes)
        near = jnp.concatenate([_near(motion, middle, known, spin), shape])
        every = jax.vmap(seen)(ends) if jax.tree.leaves(ends) else seen({})[None]
        return near, reflectances.weights(file, values), every

    @jax.jit
    def curves(middle, rows, epochs: Epochs, lit: Lit | None):
        return jax.lax.map(lambda x: parts(middle, x[0], with_lit(epochs, x[1])), (rows, lit))

    attitude = jax.jit(lambda sites, epochs: _motion_at(sites, epochs, file, options).attitude)
    expanded = jax.jit(body_expansion.BodyExpansion.of)

    def at(z: np.ndarray) -> Epochs:
        here = shaded(problem, z, data)
        middle = attitude(compiled(problem.constrain)(jnp.asarray(z), here), data)
        few = jax.eval_shape(parts, middle, z, here)[0].size
        number = body_expansion.FITTED * body_expansion.number_of_monomials(few)
        root = jnp.linalg.cholesky(compiled(problem.fisher)(z, here))
        rows = likely_draws(jnp.asarray(z), root, number)
        found = over_draws(partial(curves, middle), problem, rows, data)
        return replace(data, expansion=expanded(middle, *map(jnp.asarray, found)))

    return at


def _values(sites, file: BodyFile):
    """The unknown parameters of each material."""
    return {
        name: {key: sites[f"{name}_{key}"] for key in unknown}
        for name, unknown in file.priors.items()
    }


def _lengths(sites, file: BodyFile):
    """The unknown lengths."""
    return {key: sites[f"{file.body.names[key[0]]}_{key[1]}"] for key in file.sizes}


def shading(*, body: str, shadows: bool = True, tolerance: float = 0.0, **options: object):  # noqa: ARG001
    """What shadows leave of each panel about directions; None if the fit has no exact shadows."""
    file = read_body_text(body_text(body), tolerance or None)
    return file.body.assembly.shading if shadows else None


def equivalents(
    *,
    body: str,
    spin: str = "flat",
    shadows: bool = True,
    **options: object,  # noqa: ARG001
):
    """Matrices on the sites of the motion that give the same motion of the same body."""
    return body_symmetry.equivalents(_file(body, spin, shadows).body, spin)


def mirrored(
    normal: np.ndarray,
    *,
    body: str,
    spin: str = "flat",
    shadows: bool = True,
    **options: object,  # noqa: ARG001
):
    """Matrices of the reflection in the plane of Sun and observer, if the body has one too."""
    return body_symmetry.mirrored(_file(body, spin, shadows).body, spin, normal)
