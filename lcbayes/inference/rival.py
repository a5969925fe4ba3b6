"""Another body that may explain the data as well as the fitted one, with another spin."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import expit

from lcbayes.core.jax_setup import jnp
from lcbayes.core.progress import Silent
from lcbayes.data.lightcurve import LightCurve
from lcbayes.geometry.spherical import unwrapped
from lcbayes.inference import search, solutions
from lcbayes.inference.fit import Posterior
from lcbayes.inference.problem_cache import build_problem
from lcbayes.inference.start_from import spin_sites
from lcbayes.modelling import registry
from lcbayes.modelling.constrained import CIRCLES, constrain_draws
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem, compiled
from lcbayes.modelling.registry import Entry

Floats = NDArray[np.float64]

SPIN = ("period_h", "pole_lon_deg", "pole_lat_deg")
FEW = 300  # points with which the rival is searched for
FIRST_STEPS, FOLLOWED = 10, 3  # damped steps from every start; of these, followed to the end
# Nats by which the rival may fit worse, and more for each parameter that it lacks: a simpler body
# has more evidence at the same fit.
SLIGHTLY, SIMPLER = 20.0, 4.0
DRAWS = 400
SHARE = 0.9  # of the posterior in an interval


class Rival(NamedTuple):
    """A body of another model at its best spin near those of a fit.

    Attributes
    ----------
    model : str
    solution : int
        The solution of the fit from whose spin it started.
    log_odds : float
        Its ln evidence minus that of the fit, both by Laplace's approximation; −inf if it fits so
        much worse that the evidence was not computed.
    rms : float
        Of its residuals, as `solutions.rms`; of a part of the points if ``log_odds`` is −inf.
    spin : mapping
        Mean and standard deviation of `SPIN`; empty if ``log_odds`` is −inf.
    held : mapping
        Probability of the 90 % interval of each quantity of that solution, averaged over both
        bodies with equal prior probabilities: p P(interval | rival) + 0.9 (1 − p), where p is the
        probability of the rival. Bodies that differ little in spin give about 0.9.
    """

    model: str
    solution: int
    log_odds: float
    rms: float
    spin: Mapping[str, tuple[float, float]]
    held: Mapping[str, float]


def rival(
    entry: Entry,
    options: Mapping[str, Any],
    curve: LightCurve,
    posterior: Posterior,
    draws: Sequence[Mapping[str, ArrayLike]],
    progress: Silent,
) -> Rival | None:
    """The best body of the rival of a model, ``RIVAL``; None if it has none, or none was found.

    Parameters
    ----------
    entry, options
        The fitted model.
    curve, posterior
        The light curve and its fit.
    draws : sequence of mappings
        Draws of `SPIN`, of each solution.
    """
    if not entry.rival or entry.replaced:
        return None
    progress.say(f"fitting the model {entry.rival} from the spins that were found, to compare")
    other = registry.find(entry.rival)
    asked = set(other.options) - set(other.coarser)  # other numbers of normals mean something else
    shared = {k: v for k, v in options.items() if k in asked}
    data, workers = posterior.data, min(os.cpu_count() or 1, FOLLOWED)
    few = Epochs.of(curve.select(_thinned(curve)), curve)
    coarse = build_problem(other, {**other.coarser, **shared}, few)[0]
    shapes = other.hook("shapes")
    assert shapes is not None
    every, period = shapes(few, **shared), float(options["period"])
    at = [spin_sites(spin, few, period) for one in draws for spin in _spins_near(one)]
    begun = np.stack([coarse.ravel({**shape, **spin}) for spin in at for shape in every])
    first = search.advanced(coarse, few, begun, FIRST_STEPS, workers, lambda _: None)
    best = np.argsort(np.nan_to_num(first.potential, nan=np.inf), kind="stable")[:FOLLOWED]
    ends = search.polish(coarse, few, first.z[best], workers)
    k = int(np.argmin(np.nan_to_num(ends.potential, nan=np.inf)))
    if not np.isfinite(ends.potential[k]):
        return None
    solution, z = int(best[k]) * len(draws) // len(begun), ends.z[k]
    fitted = build_problem(entry, options, few)[0]
    fit = _log_likelihood(fitted, posterior.modes[solution].solution.z, few)
    counted = float(jnp.sum(data.information * jnp.ones(data.t.size))) / few.t.size
    worse = counted * (fit - _log_likelihood(coarse, z, few))
    if worse > SLIGHTLY + SIMPLER * max(0, fitted.dim - coarse.dim):
        return Rival(other.name, solution, -np.inf, solutions.rms(coarse, z, few), {}, {})

    problem = build_problem(other, shared, data)[0]
    z, potential = solutions.optimum(problem, data, z, np.arange(problem.dim))
    if not np.isfinite(potential):
        return None
    information = np.asarray(compiled(problem.fisher)(jnp.asarray(z), data))
    alike = other.hook("equivalents")
    images = 1 if alike is None else len(alike(**shared))
    log_evidence = solutions.laplace(potential, information) + np.log(images)
    own = np.logaddexp.reduce([mode.solution.log_evidence for mode in posterior.modes])
    log_odds = float(log_evidence - own)
    sampled = _spins(problem, data, z, information)
    spin = {k: (float(np.mean(v)), float(np.std(v, ddof=1))) for k, v in sampled.items()}
    held = _held(sampled, draws[solution], log_odds)
    rms = solutions.rms(problem, z, data)
    return Rival(other.name, solution, log_odds, rms, spin, held)


def _log_likelihood(problem: Problem, z: Floats, data: Epochs) -> float:
    return float(jnp.sum(compiled(problem.log_likelihood)(jnp.asarray(z), data)))


def _thinned(curve: LightCurve) -> NDArray[np.bool_]:
    """Points (T,), evenly along each curve, `FEW` or little more of all."""
    keep = np.zeros(curve.n_obs, bool)
    step = max(1, curve.n_obs // FEW)
    for k in range(curve.n_curves):
        keep[np.flatnonzero(curve.curve == k)[::step]] = True
    return keep


def _spins_near(draws: Mapping[str, ArrayLike]) -> list[dict[str, float]]:
    """The mean spin of a solution, and that with the opposite longitude of the pole, which light
    curves from near the ecliptic hardly tell apart."""
    mean = {k: float(_unwrapped(k, draws[k]).mean()) for k in SPIN}
    return [mean, {**mean, "pole_lon_deg": mean["pole_lon_deg"] + 180.0}]


def _spins(problem: Problem, data: Epochs, z: Floats, information: Floats) -> dict[str, Floats]:
    """Draws of `SPIN` from the Gaussian about an optimum, longitudes without a jump."""
    noise = np.random.default_rng(0).standard_normal((DRAWS, len(z)))
    values, vectors = np.linalg.eigh(information)
    rows = z + noise / np.sqrt(np.maximum(values, 1e-12 * values[-1])) @ vectors.T
    sites = constrain_draws(problem, rows[None], data)
    finite = np.all([np.isfinite(sites[k]).ravel() for k in SPIN], axis=0)
    found = {k: np.asarray(sites[k], float).ravel()[finite] for k in SPIN}
    return {k: _unwrapped(k, v) for k, v in found.items()}


def _held(
    sampled: Mapping[str, Floats], draws: Mapping[str, ArrayLike], log_odds: float
) -> dict[str, float]:
    """Probability of the 90 % interval of each quantity of a solution; see `Rival`."""
    p, held = float(expit(log_odds)), {}
    for k, values in sampled.items():
        own, theirs = _unwrapped(k, draws[k]), _unwrapped(k, values)
        if k in CIRCLES:
            theirs = theirs + CIRCLES[k] * np.round((own.mean() - theirs.mean()) / CIRCLES[k])
        low, high = np.quantile(own, [0.5 - 0.5 * SHARE, 0.5 + 0.5 * SHARE])
        share = float(np.mean((theirs >= low) & (theirs <= high)))
        held[k] = p * share + (1.0 - p) * SHARE
    return held


def _unwrapped(name: str, values: ArrayLike) -> Floats:
    """Longitudes without a jump; other quantities as they are."""
    return unwrapped(values, CIRCLES[name]) if name in CIRCLES else np.asarray(values, float)
