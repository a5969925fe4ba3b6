"""One number of facets in a comparison: its evidence, fit and diagnostics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.reasons import Finding
from lcbayes.inference import correlation as information
from lcbayes.inference import goodness_of_fit as misfit
from lcbayes.inference import search
from lcbayes.inference.area_prior import AREA
from lcbayes.inference.basins import evenly
from lcbayes.inference.fit import Posterior
from lcbayes.inference.goodness_of_fit import Misfit
from lcbayes.inference.loo import Loo, loo
from lcbayes.inference.odds import facets
from lcbayes.inference.prior_mass import log_prior_mass
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem, compiled
from lcbayes.samplers import smc
from lcbayes.samplers.bridge import LogEvidence
from lcbayes.samplers.settings import PARTICLES

Floats = NDArray[np.float64]

LOO_DRAWS = 2000


@dataclass(frozen=True)
class Candidate:
    """A number of facets and its evidence, fit and diagnostics.

    Attributes
    ----------
    n_facets, n_parameters : int
        Number of facets, and total number of parameters.
    log_evidences : (R,)
        Log evidence of each run, under the prior conditioned on every facet being seen.
    log_evidence, se : float
        ln of the mean evidence; its error, including that of the prior mass.
    spread : float
        Standard deviation of the runs' ln evidence.
    log_prior_mass : float
        `lcbayes.inference.prior_mass`; already subtracted.
    loo : Loo
    misfit : Misfit
        Misfit of the best fit reached from the best particle.
    information : float
        Information per point, from the residuals of the best particle.
    best : float
        ln likelihood of the best particle, with each point at full weight.
    z_best : (D,)
        The best particle.
    log_areas : (S, N)
        ln of the albedo-areas with a log-normal prior, of equally weighted draws; S = 0 if the
        model has none.
    posterior : Posterior or None
        Draws of each solution.
    doubt : str
        Why chains were not relied on, if they were tried.
    body : str
        Name of a kind of body; empty for a number of facets.
    options : mapping
        Of the model of that kind.
    reasons : list of Finding
        Reasons why the result is unreliable; empty if there are no problems.
    """

    n_facets: int
    n_parameters: int
    log_evidences: Floats
    log_evidence: float
    se: float
    log_prior_mass: float
    loo: Loo
    misfit: Misfit
    information: float
    best: float
    z_best: Floats
    gradients: int
    seconds: float
    reasons: list[Finding] = field(default_factory=list)
    log_areas: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    posterior: Posterior | None = None
    doubt: str = ""
    body: str = ""
    options: Mapping[str, Any] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """The kind of body, or the number of facets in words."""
        return self.body or facets(self.n_facets)

    @property
    def from_chains(self) -> bool:
        """Whether the evidence is that of chains and bridges."""
        return self.posterior is not None and self.posterior.settings.sampler != PARTICLES

    @property
    def spread(self) -> float:
        return float(np.std(self.log_evidences, ddof=1))


def candidate(
    n: int,
    problem: Problem,
    data: Epochs,
    runs: Sequence[smc.Result],
    evidence: tuple[LogEvidence, Floats, list[Finding]],
    key: jax.Array,
) -> Candidate:
    """A candidate from its total evidence, that of each run, and the reasons against them."""
    mass = log_prior_mass(problem, data, key)
    total, log_z = evidence[0], evidence[1] - mass.value
    best = _best_particle(runs)
    optimum = search.polish(problem, data, best[None], 1).z[0]
    rows = jnp.asarray(np.vstack([_pooled(runs), best]))
    log_likelihood = np.asarray(_pointwise(problem, rows, data))
    log_areas = np.zeros((0, 0))
    if AREA in problem.names:
        log_areas = np.asarray(_log_areas(problem, rows[:-1], data))
    own = information.tempered(problem, best, data)
    reasons = list(dict.fromkeys(reason for r in runs for reason in r.reasons))
    reasons += evidence[2]
    return Candidate(
        n_facets=n,
        n_parameters=problem.n_parameters,
        log_evidences=log_z,
        log_evidence=total.value - mass.value,
        se=float(np.hypot(total.se, mass.se)),
        log_prior_mass=mass.value,
        loo=loo(log_likelihood[:-1], float(data.information)),
        misfit=misfit.measure(problem, data, np.stack([best, optimum])),
        information=float(own.information),
        best=float(log_likelihood[-1].sum()),
        z_best=best,
        gradients=sum(r.gradients for r in runs),
        seconds=sum(r.seconds for r in runs),
        reasons=reasons,
        log_areas=log_areas,
    )


def _pooled(runs: Sequence[smc.Result]) -> Floats:
    """Equally weighted draws of all runs; each run is weighted by its evidence (unbiased)."""
    log_z = np.array([r.log_evidence for r in runs])
    share = np.exp(log_z - logsumexp(log_z))
    n = min(LOO_DRAWS, min(len(r.z) for r in runs) / share.max())
    parts = np.floor(n * share).astype(int)
    return np.concatenate([evenly(r.z, k) for r, k in zip(runs, parts, strict=True)])


def _best_particle(runs: Sequence[smc.Result]) -> Floats:
    best = max(runs, key=lambda r: r.log_likelihood.max())
    return best.z[np.argmax(best.log_likelihood)]


def log_likelihood(problem: Problem, z: Floats, data: Epochs) -> float:
    """ln likelihood of all points, each at full weight."""
    return float(compiled(problem.log_likelihood)(jnp.asarray(z), data).sum())


@partial(jax.jit, static_argnums=0)
def _pointwise(problem: Problem, rows: jax.Array, data: Epochs) -> jax.Array:
    """ln likelihood of every point at rows (n, D), as (n, T)."""
    return jax.lax.map(lambda row: problem.log_likelihood(row, data), rows)


@partial(jax.jit, static_argnums=0)
def _log_areas(problem: Problem, rows: jax.Array, data: Epochs) -> jax.Array:
    return jax.lax.map(lambda row: problem.constrain(row, data)[AREA], rows)
