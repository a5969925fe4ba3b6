"""Solutions from independent particle populations: separated, merged and weighted.

`lcbayes.samplers.smc` moves particles from the prior to the full posterior. The number of particles
at a solution is proportional to its weight, whether or not a search found the solution. Several
independent runs give the result by their mean and its error by their scatter.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax
from lcbayes.core.progress import Silent
from lcbayes.core.reasons import Finding
from lcbayes.inference import basins, solutions
from lcbayes.inference.basins import evenly
from lcbayes.inference.label_switching import FacetOrder
from lcbayes.inference.modes import MAX_LEFT_OUT, Mode, left_out
from lcbayes.inference.replicates import Execution
from lcbayes.modelling.constrained import potentials
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.samplers import smc
from lcbayes.samplers.bridge import LogEvidence
from lcbayes.samplers.sampling import Timing
from lcbayes.samplers.settings import Settings

Floats = NDArray[np.float64]

DRAWS_PER_PARTICLE = 3  # draws of a solution per particle of a run
MIN_WEIGHT = 1e-3  # of a reported solution
MAX_WEIGHT_SD = 0.1  # scatter of a weight between consistent runs
MIN_RELATIVE_COUNT = 0.1  # particles at a solution, relative to the run with the most


def sample(
    problem: Problem,
    data: Epochs,
    known: Sequence[solutions.Solution],
    order: FacetOrder,
    execution: Execution,
    key: jax.Array,
    timing: Timing,
    progress: Silent,
) -> tuple[list[Mode], LogEvidence, list[Finding]]:
    """Solutions with draws and weights, the heaviest first; the total evidence; warnings.

    There is one run for each chain in the settings. Each chain of a solution holds the particles of
    one run that found it, so that R-hat compares independent runs.

    Parameters
    ----------
    known
        Solutions of the search, as initial centres.
    """
    settings = execution.settings
    runs = _runs(problem, data, execution, key, timing, progress)
    measured = basins.measure(
        problem,
        data,
        runs,
        order,
        seed=settings.seed,
        max_optima=4 * settings.max_modes,
        known=[s.z for s in known],
        workers=execution.workers,
    )
    reasons = [*(reason for r in runs for reason in r.reasons), *measured.weighed.reasons]
    modes, warnings = solutions_of(problem, data, measured, settings)
    return modes, measured.weighed.log_evidence, reasons + warnings


def solutions_of(
    problem: Problem, data: Epochs, measured: basins.Measured, settings: Settings
) -> tuple[list[Mode], list[Finding]]:
    """Solutions with their draws and weights, the heaviest first, and warnings about them."""
    by_optima, label, placed, weighed = measured
    weight = weighed.weight
    shown = [int(k) for k in np.argsort(-weight) if weight[k] >= MIN_WEIGHT]
    kept, left = shown[: settings.max_modes], shown[settings.max_modes :]
    modes, reasons = [], left_out(len(left), float(weight[left].sum()))
    for place, k in enumerate(kept):
        draws, n_runs = _chains(placed, label == k, DRAWS_PER_PARTICLE * settings.num_samples)
        shares, sd = weighed.by_run[:, k], float(weighed.weight_sd[k])
        own = LogEvidence(
            float(weighed.log_evidence.value + np.log(weight[k])),
            float(np.hypot(weighed.log_evidence.se, sd / weight[k])),
        )
        stats = _statistics(problem, data, draws)
        of_all = float(weight[k])
        modes.append(Mode(by_optima.optima[k], draws, stats, own, of_all, sd, run_weights=shares))
        if n_runs < 2 and of_all > MAX_LEFT_OUT:
            values = {"found": n_runs, "runs": len(placed), "solution": place + 1}
            reasons.append(Finding("solution-found-by-few-runs", values))
        if shares.std(ddof=1) > MAX_WEIGHT_SD:
            apart = {"low": float(shares.min()), "high": float(shares.max())}
            reasons.append(Finding("weights-differ", apart | {"solution": place + 1}))
    return modes, reasons


def _runs(
    problem: Problem,
    data: Epochs,
    execution: Execution,
    key: jax.Array,
    timing: Timing,
    progress: Silent,
) -> list[smc.Result]:
    """One run for each chain in the settings."""
    try:
        n_runs = execution.settings.num_chains
        runs = execution.runs(problem, data, key, n_runs, "population", progress)
    except smc.Collapse as fault:
        raise InputError(f"{fault} (--num-samples), or choose --sampler nuts") from None
    timing.gradients += sum(r.gradients for r in runs)
    timing.sampling_s += sum(r.seconds for r in runs)
    return runs


def _chains(placed: Floats, here: NDArray[np.bool_], n: int) -> tuple[Floats, int]:
    """Draws (C, n, D) of one solution from each run that found it, and the number of these runs.

    Runs without particles at the solution are omitted. If fewer than two runs remain, all particles
    form one chain, for which there is no R-hat.
    """
    counts = here.sum(axis=1)
    represented = np.flatnonzero(counts >= MIN_RELATIVE_COUNT * counts.max())
    if len(represented) < 2:
        return evenly(placed[here], n)[None], len(represented)
    return np.stack([evenly(placed[c][here[c]], n) for c in represented]), len(represented)


def _statistics(problem: Problem, data: Epochs, z: Floats) -> dict[str, NDArray]:
    """Chain statistics, as far as they are available for particles; (C, S) each."""
    flat = z.reshape(-1, z.shape[-1])
    return {
        "potential_energy": potentials(problem, flat, data).reshape(z.shape[:2]),
        "diverging": np.zeros(z.shape[:2], bool),
    }
