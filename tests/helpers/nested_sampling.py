"""Evidence by nested slice sampling, which has nothing in common with tempering but the model.

blackjax's sampler, in coordinates in which every prior is a standard Gaussian: an isotropic
Gaussian vector for each direction, whose length says nothing; (ln α − mean)/sd for each
albedo-area; ω over its sd. Neither the density of the package's priors nor a Jacobian enters: only
how the model turns values of its sites into a likelihood, and the factors it multiplies in.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.modelling.recorded import Sites
from lcbayes.samplers.bridge import LogEvidence

LEFT = -5.0  # ln of the share of the evidence in the live points at which a run ends
SLICES = 5  # for each dimension and new point
SHRINKAGES = 200  # simulated, for the error


def sites(u: jax.Array, n_facets: int, spin: bool) -> Sites:
    """Sites of `lcbayes.models.faceted` with its default priors at a standard Gaussian vector."""
    direction, log_area, omega = jnp.split(u, [3 * n_facets, 4 * n_facets])
    rows = direction.reshape(n_facets, 3)
    result = {
        "normals_base": rows / jnp.linalg.norm(rows, axis=1, keepdims=True),
        "log_albedo_area": log_area,
    }
    return result | ({"omega_unit": omega} if spin else {})


def log_evidence(
    problem: Problem, data: Epochs, key: jax.Array, n_facets: int, spin: bool, n_live: int = 1000
) -> tuple[LogEvidence, int]:
    """ln ∫ p(y | u) f(u) N(u; 0, I) du, f the model's factors, and evaluations of the likelihood.

    A tenth of the live points is replaced at a time, each by `SLICES` slices for each dimension.
    The error is that of the volumes, simulated; whether the slices mix only other keys show.
    """
    nss = import_module("blackjax.ns.nss")  # not in every environment, nor for a type checker
    utils = import_module("blackjax.ns.utils")

    dim = 4 * n_facets + 3 * spin

    def likelihood(u: jax.Array) -> jax.Array:
        z = problem.ravel(sites(u, n_facets, spin))
        return jnp.sum(problem.log_likelihood(z, data)) + problem.log_factors(z, data)

    def prior(u: jax.Array) -> jax.Array:
        return -0.5 * jnp.sum(u**2)

    sampler = nss.as_top_level_api(
        prior, likelihood, num_inner_steps=SLICES * dim, num_delete=n_live // 10
    )
    step = jax.jit(sampler.step)
    key, key_first = jax.random.split(key)
    state: Any = jax.jit(sampler.init)(jax.random.normal(key_first, (n_live, dim)))
    dead = []
    while state.integrator.logZ_live - state.integrator.logZ > LEFT:
        key, key_step = jax.random.split(key)
        state, info = step(key_step, state)
        dead.append(info)
    everything = utils.finalise(state, dead)
    weights = np.asarray(utils.log_weights(key, everything, SHRINKAGES))
    values = np.logaddexp.reduce(weights, axis=0)
    update: Any = everything.update_info
    spent = int(update.num_expansions.sum() + update.num_shrink.sum())
    return LogEvidence(float(values.mean()), float(values.std())), spent


def pooled(runs: list[LogEvidence]) -> LogEvidence:
    """Mean over runs; its error from each run's own, or from their scatter where that is more."""
    values = [run.value for run in runs]
    own = np.sqrt(np.mean([run.se**2 for run in runs]))
    scatter = np.std(values, ddof=1)
    return LogEvidence(float(np.mean(values)), float(max(own, scatter) / np.sqrt(len(runs))))
