"""The four MCMC samplers as NumPyro kernels with a common state."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from jax.flatten_util import ravel_pytree
from numpyro.infer.mcmc import MCMCKernel
from numpyro.util import is_prng_key

from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.modelling.problem import Problem
from lcbayes.samplers.kernels import adaptation, ahmc, hmc, mh, rmhmc, scoring
from lcbayes.samplers.kernels.trajectory import Info, State

STARTS = 10  # number of prior draws, the best of which starts a chain
MIN_RELATIVE_ACCEPTANCE = 0.05  # acceptance rate over its target, below which a chain is stuck


class KernelState(NamedTuple):
    """State of a chain: the fields of NumPyro and the adaptation, all as arrays for storage."""

    i: jax.Array  # transitions so far, including warm-up
    z: Any  # unconstrained, in the form that the potential takes
    z_grad: jax.Array  # (D,)
    potential_energy: jax.Array
    energy: jax.Array
    num_steps: jax.Array  # gradients in the last transition
    num_metric: jax.Array  # Fisher matrices in the last transition
    accept_prob: jax.Array
    mean_accept_prob: jax.Array  # since the start of the phase
    diverging: jax.Array
    failed: jax.Array  # an implicit step of the last transition did not converge or reverse
    num_failed: jax.Array  # such transitions since the start of the phase
    num_fallback: jax.Array  # singular metrics since the start of the phase
    step_size: jax.Array
    adapt_state: adaptation.Tuning
    num_warmup: jax.Array
    rng_key: jax.Array


class Target(NamedTuple):
    """The posterior as a function of flat vectors."""

    potential: Callable[[jax.Array], jax.Array]
    fisher: Callable[[jax.Array], jax.Array] | None
    unravel: Callable[[jax.Array], Any]

    def metric(self, z: jax.Array) -> jax.Array:
        """The Fisher information, for kernels that require it."""
        assert self.fisher is not None
        return self.fisher(z)


class Kernel(MCMCKernel):
    """Base class of the four kernels.

    Parameters
    ----------
    model
        A model of this package, called as ``model(data)``. The state is then a dict of
        unconstrained sites.
    potential_fn
        Alternative to a model: U(z, *model_args), −ln of the density, with z any pytree.
    fisher_fn
        G(z, *model_args) -> (D, D) in the order of ``ravel_pytree(z)``: Fisher information plus
        the prior's precision.
    step_size, num_steps
        Adapted during warm-up unless given.
    covariance
        S (D, D), adapted during warm-up unless given. Without warm-up, the default is the unit
        matrix.
    target_accept_prob
        Target acceptance rate of the step size adaptation.

    Raises
    ------
    InputError
        If the arguments are invalid or inconsistent.
    """

    # Unless this is set, NumPyro calls init before it continues from a stored state. This is not
    # necessary, because `sample` depends only on the state and the model's arguments.
    _sample_fn = "sample"
    _deltas: tuple[float, ...] = (np.inf,)
    _lengths: tuple[int, ...] = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48)

    def __init__(
        self,
        model: Callable[..., Any] | None = None,
        *,
        potential_fn: Callable[..., jax.Array] | None = None,
        fisher_fn: Callable[..., jax.Array] | None = None,
        step_size: float | None = None,
        num_steps: int | None = None,
        covariance: Any = None,
        target_accept_prob: float = 0.8,
    ) -> None:
        name = type(self).__name__
        if (model is None) == (potential_fn is None):
            raise InputError(f"{name} takes either a model or potential_fn; give one of them")
        if model is not None and fisher_fn is not None:
            raise InputError(f"{name} finds a model's Fisher information itself; drop fisher_fn")
        if step_size is not None and not (np.isfinite(step_size) and step_size > 0):
            raise InputError(f"step_size is {step_size}; give a number > 0, or None to find it")
        if num_steps is not None and (int(num_steps) != num_steps or num_steps < 1):
            raise InputError(f"num_steps is {num_steps}; give an integer >= 1, or None to find it")
        if not 0 < target_accept_prob < 1:
            raise InputError(f"target_accept_prob is {target_accept_prob}; give 0 < p < 1")
        if covariance is not None:
            covariance = _covariance(covariance)
        self.model = model
        self._potential_fn = potential_fn
        self._fisher_fn = fisher_fn
        self._step_size = step_size
        self._num_steps = num_steps
        self._target_accept_prob = target_accept_prob
        self._tuner: Any = adaptation.Tuner(
            deltas=self._deltas,
            lengths=self._lengths if num_steps is None else (int(num_steps),),
            metric_cost=tuple(self._metric_cost(d) for d in self._deltas),
            target=target_accept_prob,
            step_size=step_size,
            covariance=covariance,
        )

    @property
    def sample_field(self) -> str:
        return "z"

    @property
    def default_fields(self) -> tuple[str, ...]:
        return ("z", "diverging")

    def _metric_cost(self, delta: float) -> float:  # noqa: ARG002
        return 0.0

    def _build(self, target: Target, record_steps: int) -> Callable[..., tuple[State, Info]]:
        raise NotImplementedError

    def _first(self, z: jax.Array, target: Target) -> State:
        return hmc.init(z, target.potential)

    def init(
        self, rng_key, num_warmup, init_params=None, model_args=(), model_kwargs=None
    ) -> KernelState:
        """State before the first transition; a batch of keys gives a batch of states."""
        if num_warmup == 0 and (self._tuner.step_size is None or self._num_steps is None):
            given = {"step_size": self._step_size, "num_steps": self._num_steps}
            lacking = " and ".join(k for k, v in given.items() if v is None)
            raise InputError(
                f"num_warmup=0 leaves nothing to find {lacking} with; give {lacking}, or a warm-up"
            )
        if self.model is None and init_params is None:
            raise InputError(f"{type(self).__name__}(potential_fn=...) needs init_params")
        start = partial(
            self._start, num_warmup=num_warmup, args=model_args, kwargs=model_kwargs or {}
        )
        if is_prng_key(rng_key):
            return start(rng_key, init_params)
        return jax.vmap(start)(rng_key, init_params)

    def _start(self, rng_key, init_params, *, num_warmup, args, kwargs) -> KernelState:
        rng_key, key_start = jax.random.split(rng_key)
        target = self._target(init_params, args, kwargs)
        if init_params is None:
            problem = self._problem(args, kwargs)
            draws = jax.vmap(lambda k: problem.prior_draw(k, *args))(
                jax.random.split(key_start, STARTS)
            )
            worth = jax.vmap(target.potential)(draws)
            z = draws[jnp.argmin(jnp.where(jnp.isfinite(worth), worth, jnp.inf))]
            z = scoring.ascend(target.potential, target.metric, z)
        else:
            z = ravel_pytree(init_params)[0].astype(float)
        state = self._first(z, target)
        tuning = self._tuner.init(z, target.fisher(z) if target.fisher else None)
        zero, no = jnp.array(0), jnp.array(False)
        return KernelState(
            i=zero,
            z=target.unravel(z),
            z_grad=state.grad,
            potential_energy=state.potential,
            energy=state.potential,
            num_steps=zero,
            num_metric=zero,
            accept_prob=jnp.zeros(()),
            mean_accept_prob=jnp.zeros(()),
            diverging=no,
            failed=no,
            num_failed=zero,
            num_fallback=zero,
            step_size=self._tuner.params(tuning).step_size,
            adapt_state=tuning,
            num_warmup=jnp.array(num_warmup),
            rng_key=rng_key,
        )

    def sample(self, state: KernelState, model_args, model_kwargs) -> KernelState:
        """One transition of one chain, or of each chain in a batch."""
        batch = not is_prng_key(state.rng_key)
        z = jax.tree.map(lambda x: x[0], state.z) if batch else state.z
        target = self._target(z, model_args, model_kwargs or {})
        warm, draw = partial(self._warm, target=target), partial(self._draw, target=target)
        if not batch:
            return jax.lax.cond(state.i < state.num_warmup, warm, draw, state)
        # One predicate for all chains, because a condition under vmap evaluates both branches.
        warming = state.i[0] < state.num_warmup[0]
        return jax.lax.cond(warming, jax.vmap(warm), jax.vmap(draw), state)

    def _warm(self, state: KernelState, *, target: Target) -> KernelState:
        k, params = self._tuner.trial(state.adapt_state, state.i, state.num_warmup)
        record = getattr(self._tuner, "longest", 0)
        new, info = self._transition(state, params, target, record)
        tuning = self._tuner.update(
            state.adapt_state,
            state.i,
            state.num_warmup,
            k,
            ravel_pytree(new.z)[0],
            info,
            target.fisher,
        )
        # The state reports the currently adapted step size.
        return new._replace(adapt_state=tuning, step_size=self._tuner.params(tuning).step_size)

    def _draw(self, state: KernelState, *, target: Target) -> KernelState:
        params = self._tuner.params(state.adapt_state)
        return self._transition(state, params, target, 0)[0]

    def _transition(self, state, params, target: Target, record: int) -> tuple[KernelState, Info]:
        rng_key, key = jax.random.split(state.rng_key)
        inner = State(ravel_pytree(state.z)[0], state.potential_energy, state.z_grad)
        inner, info = self._build(target, record)(key, inner, params)
        n = state.i + 1 - jnp.where(state.i < state.num_warmup, 0, state.num_warmup)
        fresh = n == 1  # the sampling phase resets the counts
        mean = jnp.where(fresh, 0.0, state.mean_accept_prob)
        state = state._replace(
            i=state.i + 1,
            z=target.unravel(inner.z),
            z_grad=inner.grad,
            potential_energy=inner.potential,
            energy=info.energy,
            num_steps=info.num_steps,
            num_metric=info.num_metric,
            accept_prob=info.accept_prob,
            mean_accept_prob=mean + (info.accept_prob - mean) / n,
            diverging=info.diverging,
            failed=info.failed,
            num_failed=jnp.where(fresh, 0, state.num_failed) + info.failed,
            num_fallback=jnp.where(fresh, 0, state.num_fallback) + info.fallback,
            rng_key=rng_key,
        )
        return state, info

    def _problem(self, args: tuple, kwargs: dict) -> Problem:
        """A new problem for each trace, because traced values must not outlive their trace."""
        assert self.model is not None
        with jax.ensure_compile_time_eval():
            return Problem(partial(self.model, **kwargs), *args)

    def _target(self, z: Any, args: tuple, kwargs: dict) -> Target:
        if self.model is not None:
            problem = self._problem(args, kwargs)
            return Target(
                lambda x: problem.potential(x, *args),
                lambda x: problem.fisher(x, *args),
                problem.unravel,
            )
        unravel = ravel_pytree(jax.tree.map(lambda x: jnp.asarray(x, float), z))[1]
        potential_fn, fisher_fn = self._potential_fn, self._fisher_fn
        assert potential_fn is not None
        return Target(
            lambda x: potential_fn(unravel(x), *args, **kwargs),
            None if fisher_fn is None else lambda x: fisher_fn(unravel(x), *args, **kwargs),
            unravel,
        )

    def postprocess_fn(self, model_args, model_kwargs):
        """Map from unconstrained sites to all sites of the model; identity without a model."""
        if self.model is None:
            return lambda z: z
        problem = self._problem(model_args, model_kwargs or {})
        return lambda z: problem.constrain(ravel_pytree(z)[0], *model_args)

    def get_diagnostics_str(self, state: KernelState) -> str:
        """Text for a progress bar."""
        text = (
            f"{int(state.num_steps)} steps of size {float(state.step_size):.2e}. "
            f"acc. prob={float(state.mean_accept_prob):.2f}"
        )
        return f"{text}. {self._faults(state)}" if self._faults(state) else text

    def describe(self, state: KernelState) -> str:
        """Text with the adapted parameters, for each chain if they differ, and any problems."""
        if np.ndim(state.i):
            n = len(np.asarray(state.i))
            each = [self.describe(jax.tree.map(lambda x, c=c: x[c], state)) for c in range(n)]
            if len(set(each)) == 1:
                return each[0]
            return "\n".join(f"chain {c + 1}: {text}" for c, text in enumerate(each))
        params = self._tuner.params(state.adapt_state)
        return "; ".join(t for t in (self._words(params), self._faults(state)) if t)

    def _words(self, params: adaptation.Params) -> str:
        name, n = type(self).__name__, int(params.num_steps)
        return f"{name}: {n} step{'s' * (n > 1)} of {float(params.step_size):.3g}"

    def _faults(self, state: KernelState) -> str:
        done, warmup = int(state.i), int(state.num_warmup)
        n = done if done <= warmup else done - warmup
        accept, words = float(state.mean_accept_prob), []
        if n >= 50 and accept < MIN_RELATIVE_ACCEPTANCE * self._target_accept_prob:
            words.append(
                f"stuck: of the last {n} proposals {100 * accept:.2g} % were accepted "
                f"(aim {100 * self._target_accept_prob:.0f} %); "
                "start elsewhere, warm up longer or give a smaller step_size"
            )
        if int(state.num_failed):
            words.append(f"{int(state.num_failed)} of {n} rejected: implicit steps did not solve")
        if int(state.num_fallback):
            words.append(f"metric singular in {int(state.num_fallback)} of {n}: frozen one taken")
        return "; ".join(words)


class MetropolisHastings(Kernel):
    """Random walk with Haario's adaptive covariance, frozen after warm-up.

    θ′ ~ N(θ, ε² S); ε starts at 2.38/√D and is adapted to an acceptance rate of 0.234.
    """

    def __init__(
        self,
        model: Callable[..., Any] | None = None,
        *,
        potential_fn: Callable[..., jax.Array] | None = None,
        fisher_fn: Callable[..., jax.Array] | None = None,
        step_size: float | None = None,
        covariance: Any = None,
        target_accept_prob: float = 0.234,
    ) -> None:
        super().__init__(
            model,
            potential_fn=potential_fn,
            fisher_fn=fisher_fn,
            step_size=step_size,
            num_steps=1,
            covariance=covariance,
            target_accept_prob=target_accept_prob,
        )
        inner = self._tuner
        self._tuner = adaptation.Haario(inner.target, inner.step_size, inner.covariance)

    def _first(self, z, target):
        return mh.init(z, target.potential)

    def _build(self, target, record_steps):  # noqa: ARG002
        return mh.build_kernel(target.potential)


class HMC(Kernel):
    """Hamiltonian Monte Carlo with the constant mass S⁻¹; the step size is jittered by ±20 %."""

    def _build(self, target, record_steps):
        return hmc.build_kernel(target.potential, record_steps)


class RMHMC(Kernel):
    """Riemannian manifold HMC: the metric is the local Fisher information; steps are implicit.

    Each step requires about a dozen Fisher matrices and one derivative. Transitions with steps that
    do not converge or are not reversible are counted (``num_failed``) and rejected.
    """

    _lengths = (1, 2, 3, 4, 6, 8)

    def __init__(self, model: Callable[..., Any] | None = None, **options: Any) -> None:
        if model is None and options.get("fisher_fn") is None:
            raise InputError("RMHMC(potential_fn=...) needs fisher_fn, its metric")
        super().__init__(model, **options)

    def _build(self, target, record_steps):
        return rmhmc.build_kernel(target.potential, target.metric, record_steps)


class AHMC(Kernel):
    """Fisher-adaptive HMC.

    ``exact=True`` leaves the posterior invariant (auxiliary point φ, see `kernels.ahmc`);
    ``exact=False`` is the published rule, which does not.

    Parameters
    ----------
    proposal_scale
        δ of Σ = δ²S, the width of φ about θ, adapted during warm-up unless given. It is inf for a
        constant metric.
    """

    _deltas = (0.5, 1.0, np.inf)

    def __init__(
        self,
        model: Callable[..., Any] | None = None,
        *,
        exact: bool = True,
        proposal_scale: float | None = None,
        **options: Any,
    ) -> None:
        if model is None and options.get("fisher_fn") is None:
            raise InputError("AHMC(potential_fn=...) needs fisher_fn, its metric")
        if proposal_scale is not None and not proposal_scale > 0:
            raise InputError(f"proposal_scale is {proposal_scale}; give a number > 0, or None")
        self._exact = exact
        if not exact:
            self._deltas = (1.0,)
            warnings.warn(
                "AHMC(exact=False) is the published rule: it does not leave the posterior "
                "invariant, and no diagnostic shows it; use it for comparison only",
                UserWarning,
                stacklevel=2,
            )
        elif proposal_scale is not None:
            self._deltas = (float(proposal_scale),)
        super().__init__(model, **options)

    def _metric_cost(self, delta):
        return adaptation.METRIC_COST if np.isfinite(delta) else 0.0

    def _build(self, target, record_steps):
        return ahmc.build_kernel(target.potential, target.metric, self._exact, record_steps)

    def proposal_scale(self, state: KernelState) -> float:
        """δ chosen in the warm-up of a chain; inf for a constant metric."""
        return float(self._tuner.params(state.adapt_state).delta)

    def _words(self, params):
        text = super()._words(params)
        if not self._exact:
            return f"{text}; the published rule, which is biased"
        delta = float(params.delta)
        if np.isinf(delta):
            return f"{text}; constant metric (delta = inf)"
        return f"{text}; metric at a point {delta:g} posterior widths away (delta = {delta:g})"


def _covariance(given: Any) -> np.ndarray:
    matrix = np.asarray(given, float)
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1]:
        raise InputError(f"covariance has shape {matrix.shape}; give a square matrix")
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        raise InputError("covariance is not positive definite; give one that is") from None
    return matrix
