"""Simulation-based calibration: test whether intervals have their nominal coverage."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.errors import InputError
from lcbayes.core.progress import Silent
from lcbayes.data.lightcurve import LightCurve
from lcbayes.modelling import variables as names
from lcbayes.tasks.fit.run import fit_with_kernel

if TYPE_CHECKING:
    from lcbayes.core.jax_setup import jax
    from lcbayes.modelling.epochs import Epochs
    from lcbayes.modelling.problem import Problem

Floats = NDArray[np.float64]
type Quantities = Callable[[Mapping[str, Floats]], dict[str, Floats]]

LIKELIHOOD = "log_likelihood"
SETTINGS = ("sampler", "num_warmup", "num_samples", "num_chains", "num_starts", "max_modes")


class Calibration(NamedTuple):
    """Ranks of the true values in the posteriors of simulated curves.

    Attributes
    ----------
    names : tuple of str
        Quantities; the last is the log-likelihood.
    places : (n, Q)
        Fraction of the draws below the true value, plus half of those equal to it: uniform in
        [0, 1] if everything is correct.
    trusted : (n,) bool
        Whether the fit passed its own diagnostics.
    """

    names: tuple[str, ...]
    places: Floats
    trusted: NDArray[np.bool_]

    def coverage(self, level: float) -> Floats:
        """Fraction of central intervals of this level that contain the true value, (Q,)."""
        return np.mean(np.abs(self.places - 0.5) < 0.5 * level, axis=0)

    def p_values(self) -> Floats:
        """p-values of uniform places by the exact Kolmogorov–Smirnov test, (Q,)."""
        from scipy.stats import kstest

        return np.array([kstest(column, "uniform").pvalue for column in self.places.T])


def calibrate(
    curve: LightCurve,
    model: str = "faceted",
    *,
    n: int = 100,
    seed: int = 0,
    quantities: Quantities | None = None,
    progress: Silent | None = None,
    **asked: Any,
) -> Calibration:
    """Fit n light curves simulated from the prior, with the geometry and the errors of one curve.

    A true value θ is drawn from the prior and data y from the model at θ. `lcbayes.fit` then gives
    draws from the posterior for y, including the search, the solutions and their weights. The place
    of f(θ) among the draws of f is uniform for every function f if prior, likelihood, sampler and
    weights are consistent (Cook, Gelman & Rubin 2006; Talts et al. 2018). The log-likelihood is one
    of these functions: without a function of the data, a posterior that ignores the data would pass
    (Modrák et al. 2023). Factors of a model, such as the visibility of facets, are at most one and
    are applied by rejection.

    Parameters
    ----------
    curve : LightCurve
        Times, geometry, errors and bands; its brightness is not used. The errors must be given, or
        the brightness must be magnitudes of known scale: the prior of an inferred scale or error
        depends on the brightness, so it cannot be sampled beforehand.
    model, **asked
        As for `lcbayes.fit`: a model, its options, the sampler and its settings.
    n : int
        Number of simulated curves.
    quantities : callable, optional
        Function from {name: draws (S, ...)} to {name: (S,)}. Default: every scalar in a summary,
        which is correct only if facets cannot be exchanged.

    Returns
    -------
    Calibration

    Raises
    ------
    InputError
        The curve has an unknown scale or error, the model infers scatter in units derived from the
        brightness, or the prior's factors reject nearly all draws.

    References
    ----------
    Talts et al. 2018, arXiv:1804.06788; Modrák et al. 2023, Bayesian Analysis (arXiv:2211.02383).
    """
    from lcbayes.core.jax_setup import jax
    from lcbayes.inference.prior_mass import accepted
    from lcbayes.inference.problem_cache import build_problem
    from lcbayes.modelling import registry
    from lcbayes.modelling.constrained import constrain_draws
    from lcbayes.modelling.epochs import Epochs
    from lcbayes.modelling.problem import compiled
    from lcbayes.results.draws import pointwise, weighted_draws

    entry = registry.find(model)
    options = {k: v for k, v in asked.items() if k not in SETTINGS}
    data = Epochs.of(curve)
    scaled_by_flux = curve.kind == "flux" and bool(np.any(np.isnan(data.error)))
    if np.any(curve.free_scale) or scaled_by_flux:
        raise InputError(
            "calibration draws scales and errors from their priors, and those of this curve "
            "depend on its brightness; give a curve of known scale, with errors if it holds fluxes"
        )
    plain, _ = build_problem(entry, entry.check(options), data)
    rest = dict(asked)
    kernel = rest.pop("sampler", "auto")
    quantities_of = quantities or scalars
    places, trusted, kept = [], [], ()
    with (progress or Silent()).stage("calibrating", n, "fits") as track:
        for i in range(n):
            key_truth, key_data = jax.random.split(jax.random.fold_in(jax.random.key(seed), i))
            truth = accepted(plain, data, key_truth, 1)[0]
            drawn = np.asarray(compiled(plain.replicate)(truth, data, key_data))
            seen = replace(curve, brightness=drawn)
            _check_noise(plain, truth, data, Epochs.of(seen))
            fitted = fit_with_kernel(seen, kernel, model=model, seed=seed + i, **rest)
            draws = weighted_draws(fitted.tree, seed=seed + i)
            sites = {str(k): np.asarray(v)[0] for k, v in draws["posterior"].data_vars.items()}
            true = constrain_draws(plain, np.asarray(truth)[None, None], data)
            true = {k: np.asarray(v)[0] for k, v in true.items()}
            likelihood = compiled(plain.log_likelihood)(truth, Epochs.of(seen))
            among = np.asarray(pointwise(draws)).sum(axis=-1).ravel()
            of_draws = quantities_of(sites) | {LIKELIHOOD: among}
            of_truth = quantities_of(true) | {LIKELIHOOD: np.array([np.sum(likelihood)])}
            kept = tuple(of_draws)
            places.append([_place(of_truth[k][0], of_draws[k]) for k in kept])
            trusted.append(fitted.trusted)
            track.advance(1)
    return Calibration(kept, np.array(places), np.array(trusted))


def _check_noise(problem: Problem, truth: jax.Array, asked: Epochs, seen: Epochs) -> None:
    """Check that the noise at the true values equals that with which the curve was simulated."""
    from lcbayes.modelling.problem import compiled

    before, after = (compiled(problem.moments)(truth, data).sd for data in (asked, seen))
    if not np.allclose(before, after, rtol=1e-9):
        raise InputError(
            "this model infers scatter in units of a curve's mean flux, which simulated curves do "
            "not share, so that it has no prior to draw from; give a curve in magnitudes"
        )


def scalars(sites: Mapping[str, Floats]) -> dict[str, Floats]:
    """Every scalar in a summary, (S,) each."""
    return {
        names.label(name, index): sites[name][(slice(None), *index)]
        for name in names.reported(sorted(sites))
        for index in np.ndindex(sites[name].shape[1:])
    }


def _place(true: float, draws: Floats) -> float:
    return float(np.mean(draws < true) + 0.5 * np.mean(draws == true))
