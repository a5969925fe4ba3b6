"""Chains of NumPyro kernels, run in blocks that can be stored and continued."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import numpyro
import numpyro.distributions as dist
from numpy.typing import NDArray
from numpyro import handlers
from numpyro.distributions import constraints
from numpyro.infer import NUTS
from numpyro.infer.mcmc import MCMCKernel

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import TRACING, Problem, compiled
from lcbayes.modelling.recorded import Sites
from lcbayes.samplers import kernels
from lcbayes.samplers.kernels import alternating, metric
from lcbayes.samplers.kernels.guided import Guided
from lcbayes.samplers.settings import FACET_MOVES, GUIDED

Floats = NDArray[np.float64]

SPREAD = 0.3
ACCEPT = 0.85  # aim of NUTS
DEPTH = 8  # maximum tree depth of NUTS: at most 2⁸ steps
INVERSE_MASS = "inverse_mass_matrix"
FIELDS = ("diverging", "energy", "potential_energy", "accept_prob", "num_steps")


class Whitening(NamedTuple):
    """z = centre + factor · y, with y such that the solution is about a unit Gaussian."""

    centre: Any  # (D,)
    factor: Any  # (D, D)

    @classmethod
    def at(cls, problem: Problem, z: Floats, data: Epochs) -> Whitening:
        """From the Fisher information at z (D,): factor factorᵀ = F⁻¹.

        The columns of ``factor`` are eigenvectors of F over the square roots of its eigenvalues.
        """
        values, vectors = np.linalg.eigh(_fisher(problem, z, data))
        # Directions that neither the data nor the prior constrain are limited to a hundred prior
        # widths.
        return cls(np.asarray(z), vectors / np.sqrt(np.maximum(values, 1e-4)))

    @classmethod
    def along_axes(cls, problem: Problem, starts: Floats, data: Epochs) -> Whitening:
        """About the first of some optima (n, D), with the median width of each coordinate.

        For kernels with a local metric: F⁻¹ at one optimum would be far too narrow, in some
        direction, for another arrangement of facets.
        """
        every = [metric.variance(jnp.asarray(_fisher(problem, z, data))) for z in starts]
        return cls(np.asarray(starts[0]), np.diag(np.sqrt(np.median(every, axis=0))))

    @classmethod
    def point(cls, z: Floats) -> Whitening:
        """A single point z (D,)."""
        return cls(z, np.zeros((z.size, z.size)))

    def __call__(self, y: jax.Array) -> jax.Array:
        return self.centre + self.factor @ y

    def inverse(self, z: jax.Array) -> jax.Array:
        """y of z, both (D,)."""
        return jnp.linalg.solve(self.factor, z - self.centre)


def _fisher(problem: Problem, z: Floats, data: Epochs) -> Floats:
    """The information (D, D), by a program that the optimiser shares, symmetric to rounding."""
    found = np.asarray(compiled(problem.fisher)(jnp.asarray(z), data))
    return 0.5 * (found + found.T)


def whitened_model(problem: Problem, which: int = 0) -> Callable[..., None]:
    """The posterior as a NumPyro model of y, for kernels that require a model.

    ``which`` of the given epochs are its data.
    """

    def model(whitening: Whitening, *epochs: Epochs) -> None:
        flat = dist.ImproperUniform(constraints.real_vector, (), (problem.dim,))
        y = jnp.asarray(numpyro.sample("y", flat))
        with handlers.block():  # hides the sites of the inner model
            density = -problem.potential(whitening(y), epochs[which])
        numpyro.factor("posterior", density)

    return model


def kernel(problem: Problem, sampler: str = "nuts") -> MCMCKernel:
    """The kernel of a name in `settings.WARMUP`, over {"y": (D,)} given (whitening, data), and, for
    `FACET_MOVES`, the moves, for `GUIDED`, the epochs of the guide."""
    nuts = {"max_tree_depth": DEPTH, "target_accept_prob": ACCEPT}
    if sampler == "nuts":
        return NUTS(whitened_model(problem), **nuts)

    def potential(z: Sites, whitening: Whitening, data: Epochs, *_) -> jax.Array:
        return problem.potential(whitening(z["y"]), data)

    def fisher(z: Sites, whitening: Whitening, data: Epochs, *_) -> jax.Array:
        factor = whitening.factor
        return factor.T @ problem.fisher(whitening(z["y"]), data) @ factor

    def moved(key: jax.Array, z: Sites, whitening: Whitening, data: Epochs, moves) -> Sites:
        return {"y": whitening.inverse(moves(key, whitening(z["y"]), data))}

    if sampler == GUIDED:
        return Guided(whitened_model(problem, 1), whitened_model(problem), **nuts)
    if sampler == FACET_MOVES:
        return alternating.Alternating(potential, fisher, moved)
    kinds = {
        "ahmc": kernels.AHMC,
        "ahmc-paper": partial(kernels.AHMC, exact=False),
        "hmc": kernels.HMC,
        "rmhmc": kernels.RMHMC,
        "mh": kernels.MetropolisHastings,
    }
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # the final report warns of the published rule
        return kinds[sampler](potential_fn=potential, fisher_fn=fisher)


def tuning(kernel: MCMCKernel, state, whitening: Whitening) -> dict[str, Any]:
    """Parameters adapted in the warm-up of one chain, given its last state (`sampling.Chains`)."""
    if isinstance(kernel, NUTS):
        (variances,) = state.adapt_state.inverse_mass_matrix.values()  # diagonal, of y
        factor = np.asarray(whitening.factor)
        return {
            "step_size": float(state.adapt_state.step_size),
            INVERSE_MASS: (factor * np.asarray(variances)) @ factor.T,
        }
    settings = {"step_size": float(state.step_size), "num_fallback": int(state.num_fallback)}
    if isinstance(kernel, kernels.AHMC):
        settings["proposal_scale"] = kernel.proposal_scale(state)
    elif isinstance(kernel, alternating.Alternating):
        settings["proposal_scale"] = alternating.DELTA
    return settings


@partial(jax.jit, static_argnums=(0, 2))
def start(kernel, key: jax.Array, num_warmup: int, near: Whitening, args: tuple):
    """Initial state of one chain, drawn near the centre of ``near``; ``args`` as for the kernel.

    The widths are those of the posterior there, with their correlations: further away, the chain
    would begin in a tail from which it may reach another solution.
    """
    whitening, *_ = args
    key_y, key = jax.random.split(key)
    y = whitening.inverse(near(SPREAD * jax.random.normal(key_y, near.centre.shape)))
    with TRACING:
        return kernel.init(key, num_warmup, {"y": y}, args, {})


@partial(jax.jit, static_argnums=(0, 1))
def advance(kernel, n_draws: int, state, args: tuple):
    """The new state, draws z (n, D) and FIELDS (n,) after ``n_draws`` transitions of one chain."""
    whitening, *_ = args

    def body(state, _):
        with TRACING:
            state = kernel.sample(state, args, {})
        return state, (whitening(state.z["y"]), {k: getattr(state, k) for k in FIELDS})

    state, (z, stats) = jax.lax.scan(body, state, length=n_draws)
    return state, z, stats
