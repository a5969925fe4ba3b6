"""Sec. VI of Linares & Crassidis as published: burn-in of chains under the squared-L1 prior.

The chains use the exact kernel and start at draws from the prior. `lcbayes compare --sparse`
descends to optima of the same posterior instead, from best fits. Both count the remaining facets
with `lcbayes.inference.sparse`.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from numpyro.infer import MCMC

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.inference import sparse
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.samplers.kernels import AHMC

Floats = NDArray[np.float64]

TRANSITIONS = 400  # 1000 in sec. VII; χ² of the cube has converged after 70
STEPS = 8  # leapfrog steps per transition


@dataclass(frozen=True)
class BurnIn:
    """Chains (C, S, D) under the sparse prior, with the χ² (C, S) of all their points."""

    problem: Problem
    data: Epochs
    z: Floats
    chi2: Floats

    @property
    def best(self) -> int:
        """Index of the chain whose last tenth fits best."""
        return int(np.argmin(self.ends.mean(axis=1)))

    @property
    def ends(self) -> Floats:
        """χ² of the last tenth, (C, S/10)."""
        return self.chi2[:, -max(1, self.chi2.shape[1] // 10) :]

    def remaining(self, chain: int) -> dict[int, float]:
        """Shares of the draws in the last tenth of a chain, by number of facets that remain."""
        z = self.z[chain, -self.ends.shape[1] :]
        return sparse.shares_of(sparse.remaining_at(self.problem, self.data, z))


def run(problem: Problem, data: Epochs, chains: int, transitions: int, seed: int) -> BurnIn:
    """Run the burn-in, during which the kernel adapts; all transitions are kept."""
    begun = time.monotonic()
    mcmc = MCMC(
        AHMC(problem.model, num_steps=STEPS),
        num_warmup=transitions,
        num_samples=1,
        num_chains=chains,
        chain_method="vectorized",
        progress_bar=False,
    )
    mcmc.warmup(jax.random.key(seed), data, collect_warmup=True)
    sites = mcmc.get_samples(group_by_chain=True)
    latent = {k: sites[k] for k in problem.names}
    z = jax.jit(jax.vmap(jax.vmap(problem.ravel)))(latent)

    def misfit(row: jax.Array) -> jax.Array:
        pulls = (data.brightness - problem.moments(row, data).mean) / data.error
        return jnp.sum(pulls**2)

    rows = z.reshape(-1, problem.dim)
    chi2 = jax.jit(lambda rows: jax.lax.map(misfit, rows, batch_size=64))(rows)
    print(f"{chains} chains of {transitions} transitions: {time.monotonic() - begun:.0f} s")
    return BurnIn(problem, data, np.asarray(z), np.asarray(chi2).reshape(chains, -1))
