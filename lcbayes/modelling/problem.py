"""The posterior of a NumPyro model and a light curve as a function of an unconstrained vector."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import partial, wraps
from threading import RLock
from typing import Any

import numpy as np
import numpyro.distributions as dist
from jax.flatten_util import ravel_pytree
from numpy.typing import NDArray
from numpyro import handlers
from numpyro.distributions import biject_to
from numpyro.distributions.transforms import Transform

from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.modelling import zero_points
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.likelihood import FLUX, OBSERVED, Law
from lcbayes.modelling.moments import MomentCoordinates
from lcbayes.modelling.nuisances import drawn_jointly
from lcbayes.modelling.nutation import RESPONSE
from lcbayes.modelling.recorded import (
    Moments,
    Sites,
    base,
    is_condition,
    is_direction,
    law_of,
    moments_of,
    power_of,
    response_of,
    weights_of,
)
from lcbayes.modelling.sites import reaching, sites_and_supports, zeros
from lcbayes.physics.bodies.lit import Lit, Shading

Coordinates = Mapping[str, Transform] | Mapping[str | tuple[str, ...], Transform]

SUN, OBS = "sun_body", "obs_body"  # sites: directions in body axes
LIT = "lit_and_seen"  # site: what shadows leave of each panel, which depends on these alone

TRACING = RLock()
"""To be held by whoever enters a NumPyro handler: they lie on one stack for all threads. Models run
only while they are traced, so compiled programs do not wait for each other."""


def _once[**P, R](method: Callable[P, R]) -> Callable[P, R]:
    """A method of a problem that is traced once for data of one structure.

    Samplers, searches and tests differentiate and batch the same functions again and again, and to
    trace a NumPyro model takes a tenth of a second. The compiled program is the same.
    """

    @wraps(method)
    def call(*args: P.args, **_: P.kwargs) -> R:
        return _call(method, *args)

    return call


class Problem:
    """The posterior of ``model`` given ``data``, over unconstrained vectors z of size ``dim``.

    Every method takes z and the data as arguments and closes over no traced values, so that one
    compiled program serves all light curves of the same size. Programs are cached for each problem
    and are reused for light curves that share it, see `lcbayes.inference.problem_cache`.

    Parameters
    ----------
    model : callable
        NumPyro model ``model(data)``; options already bound.
    data : Epochs
        Provides the shapes and the data of the first trace.
    coordinates : mapping, optional
        Transforms from unconstrained to constrained values of the named sites, in place of those
        of NumPyro, such that the posterior is easier to sample. A tuple names several sites of one
        number each, which a transform of vectors moves together.
    shading : Shading, optional
        How shadows are computed, if the model takes what they leave from the epochs.

    Raises
    ------
    InputError
        If the model does not condition on ``brightness`` with a Normal or Student-t distribution,
        or has discrete or data-dependent sites.
    """

    def __init__(
        self,
        model: Callable[[Epochs], Any],
        data: Epochs,
        coordinates: Coordinates | None = None,
        shading: Shading | None = None,
    ) -> None:
        self.model, self.shading = model, shading
        trace, supports = sites_and_supports(partial(self.trace, {}), data)
        latent = {k: v for k, v in trace.items() if v["type"] == "sample" and not v["is_observed"]}
        observed = trace.get(OBSERVED)
        if observed is None or not observed.get("is_observed"):
            raise InputError(
                f"the model has no observed site {OBSERVED!r}; "
                "end it with lcbayes.modelling.likelihood.observe(data, flux)"
            )
        if not isinstance(base(observed["fn"]), dist.Normal | dist.StudentT):
            raise InputError(
                f"the model's site {OBSERVED!r} is a {type(observed['fn']).__name__}; "
                "expected Normal or StudentT"
            )
        for name, support in supports.items():
            if support.is_discrete:
                raise InputError(f"the model's site {name!r} is discrete; marginalise it out")
        self._transforms: dict[tuple[str, ...], Transform] = {}
        self._transforms |= {(k,): biject_to(support) for k, support in supports.items()}
        for given, transform in (coordinates or {}).items():
            names = (given,) if isinstance(given, str) else given
            self._transforms = {k: v for k, v in self._transforms.items() if k[0] not in names}
            self._transforms[names] = transform
        template = zeros(
            jax.eval_shape(self._free, zeros({k: v["value"] for k, v in latent.items()}))
        )
        flat, self.unravel = ravel_pytree(template)
        self.dim = int(flat.size)
        self.law: Law = law_of(base(observed["fn"]))
        lengths = (np.prod(v["fn"].batch_shape) for v in latent.values() if is_direction(v))
        # The lengths of direction vectors do not count as parameters.
        redundant = (getattr(v["fn"], "redundant", 0) for v in latent.values())
        self.n_parameters = self.dim - int(sum(lengths)) - sum(redundant)
        self.names = tuple(sorted(latent))
        # NumPy only, because JAX may be tracing.
        ends = np.cumsum([template[k].size for k in self.names])
        self._rows = {
            k: np.arange(end - template[k].size, end)
            for k, end in zip(self.names, ends, strict=True)
        }
        self._gaussian = [k for k in self.names if isinstance(base(latent[k]["fn"]), dist.Normal)]
        moving = reaching(lambda free: self._flux(free, data), template)
        turning = reaching(lambda free: self._turned(free, data), template)
        facets = [(k,) for k in moving if k not in turning]
        self._turning = tuple(k for k in moving if k in turning)
        self._body = [g for g in (*facets, self._turning) if g]
        widths = reaching(
            lambda free: self._conditions(data, {}, free, self._flux(free, data)).sd, template
        )
        self._knows_errors = not widths
        # the sites on which the data depend other than through the flux
        held, flux = zeros(response_of(trace)), zeros(trace[FLUX]["value"])
        self._direct = reaching(lambda free: self._conditions(data, held, free, flux), template)
        moved = self.rows(k for group in self._body for k in group)
        self._still = np.setdiff1d(np.arange(self.dim), moved)
        self._body_order = np.argsort(np.concatenate([self._still, moved]))

    def ravel(self, sites: Sites) -> jax.Array:
        """The flat unconstrained vector of constrained values; those of other sites are ignored."""
        return ravel_pytree(self._free(sites))[0]

    def replaced(self, z: jax.Array, changes: Mapping[str, Callable[[jax.Array], jax.Array]]):
        """z with some sites replaced by functions of their constrained values."""
        free = dict(self.unravel(z))
        for name, change in changes.items():
            transform = self._transforms[(name,)]
            free[name] = transform.inv(change(jnp.asarray(transform(free[name]))))
        return ravel_pytree(free)[0]

    def rows(self, names: Iterable[str]) -> NDArray[np.int64]:
        """Indices of some sites in the flat vector."""
        return np.concatenate([np.zeros(0, np.int64), *(self._rows[k] for k in names)])

    def _sites(self, free: Sites, data: Epochs) -> tuple[Sites, jax.Array]:
        sites, log_det = {}, jnp.zeros(())
        start = getattr(data.expansion, "start", None)
        for names, transform in self._transforms.items():
            x = _joined(names, free)
            y = transform(x, start) if isinstance(transform, MomentCoordinates) else transform(x)
            sites |= _separate(names, y)
            log_det += jnp.sum(transform.log_abs_det_jacobian(x, y))
        return sites, log_det

    def _free(self, sites: Sites) -> Sites:
        free = {}
        for names, transform in self._transforms.items():
            free |= _separate(names, transform.inv(_joined(names, sites)))
        return free

    def _trace(self, z: jax.Array | Sites, data: Epochs):
        sites, log_det = self._sites(z if isinstance(z, dict) else self.unravel(z), data)
        return self.trace(sites, data), log_det

    def trace(self, sites: Sites, data: Epochs, key: jax.Array | None = None) -> dict[str, Any]:
        """All sites of the model as NumPyro records them, at given constrained values.

        Sites without a given value are drawn with ``key``, by default a fixed one.
        """
        with TRACING:
            seeded = handlers.seed(self.model, jax.random.key(0) if key is None else key)
            return handlers.trace(handlers.substitute(seeded, sites)).get_trace(data)

    @_once
    def potential(self, z: jax.Array, data: Epochs) -> jax.Array:
        """−log p(y, z) with respect to z."""
        trace, log_det = self._trace(z, data)
        return -log_det - sum(
            jnp.sum(v["fn"].log_prob(v["value"]) * power_of(v))
            for v in trace.values()
            if v["type"] == "sample"
        )

    def slope(self, z: jax.Array, data: Epochs) -> jax.Array:
        """Gradient of the potential, (D,)."""
        return jax.grad(self.potential)(z, data)

    @_once
    def log_factors(self, z: jax.Array, data: Epochs) -> jax.Array:
        """ln of the model's factors besides the prior and the brightness, such as visibility."""
        trace, _ = self._trace(z, data)
        return sum(
            (
                jnp.sum(v["fn"].log_prob(v["value"]) * power_of(v))
                for k, v in trace.items()
                if v["type"] == "sample" and v["is_observed"] and k != OBSERVED
            ),
            start=jnp.zeros(()),
        )

    def log_prior(self, z: jax.Array, data: Epochs) -> Sites:
        """ln of the prior density of each latent site in its unit, without `log_factors`."""
        trace, _ = self._trace(z, data)
        return {
            k: jnp.sum(trace[k]["fn"].log_prob(trace[k]["value"]) * power_of(trace[k]))
            for k in self.names
        }

    @_once
    def moments(self, z: jax.Array | Sites, data: Epochs) -> Moments:
        """Centre and width of the likelihood; z is flat or a dict of unconstrained sites."""
        return moments_of(self._trace(z, data)[0][OBSERVED])

    def directions(self, z: jax.Array, data: Epochs) -> tuple[jax.Array, jax.Array]:
        """Of Sun and observer in body axes, (T, 3) each."""
        trace, _ = self._trace(z, data)
        return trace[SUN]["value"], trace[OBS]["value"]

    def flux_at(self, z: jax.Array, data: Epochs) -> jax.Array:
        """The flux that the model passes to `likelihood.observe`, (T,)."""
        return self._flux(self.unravel(z), data)

    def response(self, z: jax.Array, data: Epochs, change: jax.Array) -> jax.Array:
        """Change of the centre of the likelihood over its width by changes of the flux, (K, T)."""
        free = self.unravel(z)

        def centre(flux: jax.Array) -> jax.Array:
            with TRACING, handlers.substitute(data={FLUX: flux}):
                return moments_of(self._trace(free, data)[0][OBSERVED]).mean

        _, push = jax.linearize(centre, self._flux(free, data))
        return jax.vmap(push)(change) / self.moments(z, data).sd

    @_once
    def _flux(self, free: Sites, data: Epochs) -> jax.Array:
        return self._trace(free, data)[0][FLUX]["value"]

    def _turned(self, free: Sites, data: Epochs) -> jax.Array:
        """The direction of the Sun in body axes, (T, 3); empty if the model has no such site."""
        trace, _ = self._trace(free, data)
        return trace[SUN]["value"] if SUN in trace else jnp.zeros(0)

    def _conditions(self, data: Epochs, held: Sites, free: Sites, flux: jax.Array) -> Moments:
        """Centres and widths of all observed sites, concatenated, for a given flux.

        A model may also condition on other quantities, such as the closure of facet areas. The
        deterministic sites ``held`` have these values whatever the parameters are.
        """
        with TRACING, handlers.substitute(data={FLUX: flux, **held}):
            trace, _ = self._trace(free, data)
        parts = [moments_of(v) for v in trace.values() if is_condition(v)]
        return Moments(
            *(jnp.concatenate([jnp.ravel(x) for x in p]) for p in zip(*parts, strict=True))
        )

    @_once
    def log_tail(self, z: jax.Array, data: Epochs) -> jax.Array:
        """ln of the one-sided tail probability of the recorded brightness y, (T,).

        It is ln F(m − |y − m|) with the noise distribution F of centre m; at most ln ½.
        """
        site = self._trace(z, data)[0][OBSERVED]
        fn = base(site["fn"])
        mirrored = fn.loc - jnp.abs(site["value"] - fn.loc)
        return fn.log_cdf(mirrored) if isinstance(fn, dist.Normal) else jnp.log(fn.cdf(mirrored))

    @_once
    def log_likelihood(
        self, z: jax.Array, data: Epochs, flux: jax.Array | None = None
    ) -> jax.Array:
        """Log-likelihood of each point at full weight, (T,), for a flux that is known or not."""
        with TRACING, handlers.substitute(data={} if flux is None else {FLUX: flux}):
            site = self._trace(z, data)[0][OBSERVED]
        return site["fn"].log_prob(site["value"])

    @_once
    def constrain(self, z: jax.Array, data: Epochs) -> Sites:
        """All latent and deterministic sites at z, in the units of the model."""
        trace, _ = self._trace(z, data)
        return {
            k: v["value"]
            for k, v in trace.items()
            if v["type"] == "deterministic" or (v["type"] == "sample" and not v["is_observed"])
        }

    def flux(self, sites: Sites, data: Epochs) -> jax.Array:
        """The flux that the model passes to `likelihood.observe`, at constrained values, (T,)."""
        return self.trace(sites, data)[FLUX]["value"]

    def replicate(
        self, z: jax.Array, data: Epochs, key: jax.Array, sites: Sites | None = None
    ) -> jax.Array:
        """A posterior predictive draw of the data given z, independent between points, (T,).

        Zero points and nutation are drawn given z and the data. ``sites`` are those of `constrain`.
        """
        sites = self.constrain(z, data) if sites is None else sites
        faults = drawn_jointly(sites, jax.random.fold_in(key, 1))
        changed = {FLUX: sites[FLUX]}  # not computed again
        if faults.nutation is not None:
            each = jnp.sum(faults.nutation[data.night].T * sites[RESPONSE], axis=0)
            changed = {FLUX: sites[FLUX] + data.sunlight * each}
        with TRACING, handlers.substitute(data=changed):
            site = self._trace(z, data.without_passes())[0][OBSERVED]
        drawn = site["fn"].sample(key)
        if faults.zero_point is None:
            return drawn
        each = jnp.append(faults.zero_point, 0.0)[data.calibration]
        return drawn + zero_points.response(data, moments_of(site).mean) * each

    @_once
    def fisher(self, z: jax.Array, data: Epochs) -> jax.Array:
        """Expected information of all observed sites plus the prior precision, (D, D).

        F = Jᵀ diag(w/σ²) J + 2 Kᵀ diag(v) K + P with J = ∂mean/∂z, K = ∂ln sd/∂z and P the
        positive part of the Hessian of −ln prior; w = (ν+1)/(ν+3), v = ν/(ν+3) for Student-t and 1
        for Normal. Factors of the model other than distributions are not included.

        The flux dominates the cost. It is therefore differentiated only along the sites on which it
        depends: along those that turn the body together, because they share the derivatives of the
        attitude, and along each other one alone, for which attitude and shadows are given.
        """
        free = self.unravel(z)
        trace, _ = self._trace(free, data)
        weights = [weights_of(v) for v in trace.values() if is_condition(v)]
        w, v = (jnp.concatenate(x) for x in zip(*weights, strict=True))
        basis = jax.vmap(self.unravel)(jnp.eye(self.dim))
        flux = trace[FLUX]["value"]
        still = replace(data, lit=Lit(trace[LIT]["value"])) if LIT in trace else data
        parts = [jnp.zeros((self._still.size, flux.size))]
        for group in self._body:
            some = {name: free[name] for name in group}
            given = data if group == self._turning else still
            along = jax.jacfwd(lambda x, given=given: self._flux({**free, **x}, given))(some)
            parts += [along[name].reshape(flux.size, -1).T for name in group]
        change = jnp.concatenate(parts)[self._body_order]
        held = response_of(trace)  # its change with the parameters is of second order

        def conditions(direct: Sites, flux: jax.Array) -> Moments:
            return self._conditions(data, held, {**free, **direct}, flux)

        moments, push_on = jax.linearize(conditions, {k: free[k] for k in self._direct}, flux)
        mean, sd = jax.vmap(push_on)({k: basis[k] for k in self._direct}, change)
        mean = mean * (jnp.sqrt(w) / moments.sd)
        information = mean @ mean.T + self.prior_precision(z, still)
        if self._knows_errors:
            return information
        sd = sd * (jnp.sqrt(2 * v) / moments.sd)
        return information + sd @ sd.T

    @_once
    def prior_precision(self, z: jax.Array, data: Epochs) -> jax.Array:
        """Precision of the prior of z, (D, D), positive semi-definite by construction.

        For Normal sites it is the expected information, Jᵀ diag(1/σ²) J + 2 Kᵀ K, with the
        Jacobians J of the value minus its mean and K of ln σ; it is thus correct for a prior whose
        width is inferred. For others it is that of a method ``precision`` of the distribution or of
        joint coordinates, or the positive part of the Hessian of −ln prior.
        """
        free = self.unravel(z)
        trace, _ = self._trace(free, data)
        sd = {k: moments_of(trace[k]).sd for k in self._gaussian}

        def residuals(z: jax.Array) -> jax.Array:
            trace, _ = self._trace(z, data)
            parts = [jnp.zeros(0)]
            for k in self._gaussian:
                mean, width = moments_of(trace[k])
                parts += [(trace[k]["value"] - mean) / sd[k], jnp.sqrt(2.0) * jnp.log(width)]
            return jnp.concatenate([jnp.ravel(x) for x in parts])

        _, push = jax.linearize(residuals, z)
        jacobian = jax.vmap(push)(jnp.eye(self.dim))
        precision = jacobian @ jacobian.T
        for names in self._transforms:
            if laws := {k: trace[k]["fn"] for k in names if k not in self._gaussian}:
                rows = self.rows(names)
                block = self._curvature(names, laws, _joined(names, free))
                precision = precision.at[np.ix_(rows, rows)].add(block)
        return precision

    def _curvature(
        self, names: tuple[str, ...], laws: Mapping[str, Any], value: jax.Array
    ) -> jax.Array:
        """Precision of the prior of sites that are transformed together."""
        transform, fn = self._transforms[names], laws[next(iter(laws))]
        if own := getattr(transform, "precision", None):
            return own(value)
        if hasattr(fn, "precision"):
            jacobian = jax.jacfwd(transform)(value).reshape(value.size, value.size)
            return jacobian.T @ fn.precision(transform(value)) @ jacobian

        def minus_log_prior(flat: jax.Array) -> jax.Array:
            free = flat.reshape(value.shape)
            y = transform(free)
            sites, log_det = _separate(names, y), transform.log_abs_det_jacobian(free, y)
            return -jnp.sum(log_det) - sum(jnp.sum(f.log_prob(sites[k])) for k, f in laws.items())

        values, vectors = jnp.linalg.eigh(jax.hessian(minus_log_prior)(value.ravel()))
        return (vectors * jnp.maximum(values, 0.0)) @ vectors.T

    def prior_draw(self, key: jax.Array, data: Epochs) -> jax.Array:
        """A draw from the prior as an unconstrained vector."""
        trace = self.trace({}, data, key)
        return self.ravel({k: trace[k]["value"] for k in self.names})


def _joined(names: tuple[str, ...], values: Sites) -> jax.Array:
    """The value of one site, or the vector of several."""
    return values[names[0]] if len(names) == 1 else jnp.stack([values[k] for k in names])


def _separate(names: tuple[str, ...], value: Any) -> Sites:
    """The inverse of `_joined`."""
    return {names[0]: value} if len(names) == 1 else dict(zip(names, value, strict=True))


def compiled(method: Callable[..., Any]) -> Callable[..., Any]:
    """A compiled method of a problem, shared by all light curves of the same structure.

    In contrast, `jax.jit(problem.method)` would compile a new program at each call. Shadows are
    computed before, by the same program for all methods; see `shaded`.
    """
    owner: Any = method
    function, problem = owner.__func__, owner.__self__

    def call(z: jax.Array, data: Epochs, *args: Any) -> Any:
        return _call(function, problem, z, shaded(problem, z, data), *args)

    return call


def lit_at(problem: Problem, z: jax.Array | NDArray[np.float64], data: Epochs) -> Lit | None:
    """What shadows leave of each panel at z, with its slopes; None if they are not computed."""
    if problem.shading is None or data.lit is not None or data.expansion is not None:
        return None
    return problem.shading.about(*_call(Problem.directions, problem, z, data))


def shaded(problem: Problem, z: jax.Array | NDArray[np.float64], data: Epochs) -> Epochs:
    """Epochs with which a program of z has the same value and derivative, without shadows.

    A program with shadows takes ten seconds to compile, and a fit has dozens of programs. Those of
    an exposure are at several times, and remain in the program.
    """
    if problem.shading is None or data.has_exposure:
        return data
    return with_lit(data, lit_at(problem, z, data))


def with_lit(data: Epochs, lit: Lit | None) -> Epochs:
    """The epochs with what shadows leave, if that is given."""
    return data if lit is None else replace(data, lit=lit)


@partial(jax.jit, static_argnums=0)
def prior_draws(problem: Problem, keys: jax.Array, data: Epochs) -> jax.Array:
    """Unconstrained vectors from the prior, one for each key, (n, D)."""
    return jax.vmap(problem.prior_draw, (0, None))(keys, data)


@partial(jax.jit, static_argnums=(0, 1))
def _call(function: Callable[..., Any], problem: Problem, *args: Any) -> Any:
    return function(problem, *args)
