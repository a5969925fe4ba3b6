"""Solutions from independent populations of particles: told apart, joined where one, weighed.

`lcbayes.inference.smc` carries particles from the prior to the whole posterior, so that a solution
has as many of them as it has weight, whether or not a search found it. What several independent
runs agree on is the result, what they differ by is its error.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from lcbayes._jax import jax, jnp
from lcbayes.checkpoint import Checkpoint
from lcbayes.epochs import Epochs
from lcbayes.errors import InputError
from lcbayes.inference import evidence, search, smc, solutions
from lcbayes.inference.facet_order import FacetOrder
from lcbayes.inference.independent import independent_runs
from lcbayes.inference.modes import OVERLAP, Mode, overlap
from lcbayes.inference.problem import Problem, compiled
from lcbayes.inference.sample import Timing
from lcbayes.inference.settings import Settings
from lcbayes.progress import Silent

Floats = NDArray[np.float64]

LOOKED_AT = 8  # points of a run that are told apart, for each particle that moves
KEPT = 3  # of them draws of a solution
CLIMBERS = 32  # particles of each run that climb to the optimum they are near
LIGHTEST = 1e-3  # a solution of less weight is not shown
DISAGREE = 0.1  # standard deviation of a weight between runs from which they disagree


def sample(
    problem: Problem,
    data: Epochs,
    found: Sequence[solutions.Solution],
    order: FacetOrder,
    settings: Settings,
    key: jax.Array,
    workers: int,
    checkpoint: Checkpoint,
    timing: Timing,
    progress: Silent,
) -> tuple[list[Mode], list[str]]:
    """The solutions with their draws and weights, the heaviest first; why not to trust them.

    One run for each chain that the settings ask for: chain c of a solution holds the particles that
    run c has there, so that R-hat compares runs that know nothing of each other.

    Parameters
    ----------
    found
        Of the search, as centres to begin with.
    """
    runs = _runs(problem, data, settings, key, workers, checkpoint, timing, progress)
    z = np.stack([evenly(r.z, LOOKED_AT * settings.num_samples) for r in runs])
    centres = _centres(problem, data, z, found, order, 4 * settings.max_modes, workers)
    label, matched = _told_apart(problem, data, z, centres, order)
    label = _joined(label, matched, order)

    log_z = np.array([r.log_evidence for r in runs])
    of_run = np.exp(log_z - logsumexp(log_z))
    counts = np.array([[np.sum(row == k) for k in range(len(centres))] for row in label])
    shares = counts / counts.sum(axis=1, keepdims=True)
    weight = of_run @ shares
    spread = shares.std(axis=0, ddof=1)
    kept = [int(k) for k in np.argsort(-weight) if weight[k] >= LIGHTEST][: settings.max_modes]

    total = logsumexp(log_z) - np.log(len(runs))
    total_se = log_z.std(ddof=1) / np.sqrt(len(runs))
    modes, reasons = [], [reason for r in runs for reason in r.reasons]
    for place, k in enumerate(kept):
        draws = _chains(matched[k], label == k, KEPT * settings.num_samples)
        share = weight[k] / weight[kept].sum()
        sd = float(spread[k] / np.sqrt(len(runs)))
        own = evidence.LogEvidence(
            float(total + np.log(weight[k])), float(np.hypot(total_se, sd / weight[k]))
        )
        stats = _statistics(problem, data, draws)
        modes.append(
            Mode(centres[k], draws, stats, own, float(share), sd, run_weights=shares[:, k])
        )
        if spread[k] > DISAGREE:
            low, high = shares[:, k].min(), shares[:, k].max()
            reasons.append(
                f"independent runs give solution {place + 1} weights from {low:.2f} to {high:.2f}: "
                "take more particles with --num-samples"
            )
    return modes, reasons


def _runs(
    problem,
    data,
    settings: Settings,
    key,
    workers,
    checkpoint: Checkpoint,
    timing: Timing,
    progress,
) -> list[smc.Result]:
    """One for each chain that the settings ask for."""
    try:
        runs = independent_runs(
            problem, data, key, settings.num_samples, settings.num_chains,
            name="population", checkpoint=checkpoint, workers=workers, progress=progress,
        )  # fmt: skip
    except smc.Collapse as fault:
        raise InputError(f"{fault} (--num-samples), or choose --sampler nuts") from None
    timing.gradients += sum(r.gradients for r in runs)
    timing.sampling_s += sum(r.seconds for r in runs)
    return runs


def evenly(rows: NDArray, n: int) -> NDArray:
    """n of the rows, or each several times where there are fewer."""
    return rows[np.linspace(0, len(rows) - 1, n).round().astype(int)]


def _centres(problem, data, z, found, order: FacetOrder, most: int, workers: int):
    """The optima of the search and those that particles of each run are near, best first."""
    climbers = np.concatenate([evenly(row, CLIMBERS) for row in z])
    rows = np.concatenate([np.stack([s.z for s in found]), climbers])
    ends = search.polish(problem, data, rows, workers)
    best_first = np.argsort(ends.potential, kind="stable")
    ends = jax.tree.map(lambda x: x[best_first], ends)
    return solutions.distinct(problem, data, ends, order, most)


def _told_apart(problem, data, z: Floats, centres, order: FacetOrder):
    """The nearest centre of each particle (C, N), and the particles (K, C, N, D) with their facets
    in the order of each centre. Near is what is so in the metric of the information there."""
    flat = z.reshape(-1, z.shape[-1])
    fisher = compiled(problem.fisher)
    matched = np.empty((len(centres), *flat.shape))
    distance = np.empty((len(centres), len(flat)))
    for k, centre in enumerate(centres):
        matched[k] = [order.like(row, centre.z) for row in flat]
        apart = matched[k] - centre.z
        metric = np.asarray(fisher(jnp.asarray(centre.z), data))
        distance[k] = np.einsum("ni,ij,nj->n", apart, metric, apart)
    label = np.argmin(distance, axis=0).reshape(z.shape[:2])
    return label, matched.reshape(len(centres), *z.shape)


def _joined(label: NDArray, matched: Floats, order: FacetOrder) -> NDArray:
    """Labels with those solutions as one whose particles lie among each other.

    A ridge has many optima along it, and the nearest of them says little of a particle.
    """
    label = label.copy()
    present = [int(k) for k in np.unique(label)]
    again = True
    while again:
        again = False
        for i, a in enumerate(present):
            for b in present[i + 1 :]:
                one, other = matched[a][label == a], matched[b][label == b]
                few = 2 * one.shape[-1]  # too few to have a region
                if min(len(one), len(other)) < few or overlap(one, other, order)[0] <= OVERLAP:
                    continue
                label[label == b] = a
                present.remove(b)
                again = True
                break
            if again:
                break
    return label


def _chains(matched: Floats, here: NDArray[np.bool_], n: int) -> Floats:
    """Draws (C, n, D) of one solution: those of each run; where a run has none, of all."""
    every = matched[here]
    return np.stack(
        [
            evenly(rows[own] if own.any() else every, n)
            for rows, own in zip(matched, here, strict=True)
        ]
    )


def _statistics(problem: Problem, data: Epochs, z: Floats) -> dict[str, NDArray]:
    """What a chain would have recorded, as far as particles have it; (C, S) each."""
    flat = jnp.asarray(z.reshape(-1, z.shape[-1]))
    return {
        "potential_energy": np.asarray(_potentials(problem, flat, data)).reshape(z.shape[:2]),
        "diverging": np.zeros(z.shape[:2], bool),
    }


@partial(jax.jit, static_argnums=0)
def _potentials(problem: Problem, rows: jax.Array, data: Epochs) -> jax.Array:
    return jax.lax.map(lambda row: problem.potential(row, data), rows)
