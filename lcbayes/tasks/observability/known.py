"""A plan from the posterior of an earlier fit: the information gained at each of its draws.

At a draw θₖ of the posterior, the information so far is F(θₖ), prior included, and a future
measurement adds ∇f ∇fᵀ/σ². A plan minimises the remaining uncertainty, averaged over the draws. All
derivatives are local to a draw. The loss of the rotational phase between passes therefore costs
nothing, because the measurements in between recover the phase. A linear fit over all draws would
have no slope at those epochs, and the plan would avoid the most informative ones.

References
----------
Chaloner & Verdinelli 1995, Statist. Sci. 10, 273, sec. 5: local criteria averaged over the
posterior.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inference.correlation import tempered
from lcbayes.physics.sensitivity import MAGNITUDE_PER_NEPER
from lcbayes.simulation.observability.measurements import Measurements
from lcbayes.simulation.observability.targets import Target, of_sites
from lcbayes.tasks.predict import brightness as predict
from lcbayes.tasks.predict.run import load_fit

Floats = NDArray[np.float64]
DRAWS = 24
_FLAT = 1e-10  # eigenvalues below this fraction of the largest (scaled information) count as zero


def from_fit(
    folder: Path, measured: Measurements, target: str, model: str | None = None
) -> tuple[Floats, Target, list[str]]:
    """Factors of measurements and target at the draws of a fit, with the noise of the scenario.

    ``model`` is the model file, if the model of the fit is a file.

    Returns
    -------
    factor : (K, T, S)
    target : Target
    notes : notes of the prediction

    Raises
    ------
    InputError
        The folder holds no fit, or a fit that does not predict the brightness at future epochs.
    """
    fit = load_fit(folder, model)
    fitted = fit.curve
    wanted = replace(measured.curve, kind=fitted.kind)
    ready = predict.Predictor.of(fit.posterior, fitted, wanted, fit.model, fit.options, DRAWS)
    if ready.own_level.any():
        raise InputError(
            f"the fit in {folder} has curves of unknown scale only, so the brightness to come is "
            "not known; plan with a fit that has a calibrated curve"
        )
    flux = measured.flux * measured.unit
    sd = measured.mag_err if fitted.kind == "mag" else flux * measured.mag_err / MAGNITUDE_PER_NEPER
    if fitted.kind == "flux" and measured.curve.kind == "flux":
        sd = np.asarray(measured.curve.error)
    factor, rows, unit = at_draws(ready, fitted, wanted, sd, target)
    return factor, Target(target, unit, rows), ready.notes


def at_draws(
    ready: predict.Predictor, fitted: LightCurve, wanted: LightCurve, sd: Floats, target: str
) -> tuple[Floats, Floats, str]:
    """Factors Aₖ = (∂f/∂z/σ) Lₖ and Bₖ = (∂target/∂z) Lₖ at each draw, L Lᵀ = F⁻¹.

    Parameters
    ----------
    sd : (T,)
        Noise at the wanted epochs, in the unit of the fitted curve; NaN where nothing is seen.

    Returns
    -------
    factor : (K, T, S), target : (K, T', S), unit of the target
    """
    problem = ready.problem
    z = jax.vmap(problem.ravel)({k: jnp.asarray(v) for k, v in ready.sites.items()})
    data = tempered(problem, np.asarray(z[len(z) // 2]), ready.data)
    unit = ""

    def asked(z: jax.Array) -> jax.Array:
        nonlocal unit
        value, unit = of_sites(problem.constrain(z, data), target)
        return value

    def known(z: jax.Array) -> tuple[jax.Array, ...]:
        return problem.fisher(z, data), jax.jacfwd(asked)(z)

    fisher, slopes = (np.asarray(x) for x in jax.jit(lambda z: jax.lax.map(known, z))(z))
    root = roots(fisher)
    rows = slopes @ root
    if unit == "":  # parts of different units: each relative to its present error
        error = np.sqrt(np.mean(np.sum(rows**2, axis=2), axis=0))
        rows, unit = rows / np.where(error > 0.0, error, 1.0)[:, None], "1"
    parts = []
    for start in range(0, wanted.n_obs, predict.CHUNK):
        some = np.arange(start, min(start + predict.CHUNK, wanted.n_obs))
        epochs = predict.epochs_of_known_scale(wanted.select(some), fitted)
        curve = wanted.curve[some]

        def brightness(z: jax.Array, epochs=epochs, curve=curve) -> jax.Array:
            return ready.brightness(z, epochs, curve)

        slope = jax.jit(lambda z, f=brightness: jax.lax.map(jax.jacfwd(f), z))(z)
        parts.append(np.asarray(slope) / sd[some, None])
    seen = np.nan_to_num(np.concatenate(parts, axis=1), posinf=0.0, neginf=0.0)
    return seen @ root, rows, unit


def roots(information: Floats) -> Floats:
    """L (K, D, D) with L Lᵀ = F⁻¹, for matrices whose units may differ greatly."""
    diagonal = np.einsum("kii->ki", information)
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    values, vectors = np.linalg.eigh(information * scale[:, :, None] * scale[:, None, :])
    values = np.maximum(values, _FLAT * values[:, -1:])
    return scale[:, :, None] * vectors / np.sqrt(values)[:, None, :]
