"""The log-normal prior on the areas of facets, with its median at the scale of the data."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.jax_setup import jnp
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem, compiled
from lcbayes.modelling.registry import Entry

Floats = NDArray[np.float64]

AREA = "log_albedo_area"  # site of the areas with a log-normal prior


class AreaPrior(NamedTuple):
    """The log-normal prior on the albedo-area of each facet.

    Attributes
    ----------
    log_mean, log_sd : float
        Of ln(α / m²).
    default : float
        The model's default of ``log_mean``.
    from_data : bool
        Whether ``log_mean`` is that of the best fit.
    """

    log_mean: float
    log_sd: float
    default: float
    from_data: bool


def area_prior_of(
    entry: Entry, options: Mapping[str, Any], problem: Problem, z: Floats, data: Epochs
) -> AreaPrior | None:
    """The prior on areas: as given, or with the median at the typical area of a best fit.

    The typical area is Σα²/Σα, the mean area of a facet weighted by area. Facets of negligible area
    do not change it. A facet divided in two does, so the fit is that of the number with the lowest
    Bayesian information criterion.
    """
    known = entry.options
    if AREA not in problem.names or not {"log_area_mean", "log_area_sd"} <= set(known):
        return None
    if AREA in entry.replaced:
        return None
    sd = float(options.get("log_area_sd", known["log_area_sd"].default))
    default = float(known["log_area_mean"].default)
    if "log_area_mean" in options:
        return AreaPrior(float(options["log_area_mean"]), sd, default, False)
    area = np.exp(np.asarray(problem.constrain(jnp.asarray(z), data)[AREA], float))
    # three digits: the same for runs that differ in the last bit
    typical = float(f"{np.sum(area**2) / np.sum(area):.3g}")
    return AreaPrior(float(np.log(typical)), sd, default, True)


def bic(problem: Problem, z: Floats, data: Epochs) -> float:
    """Bayesian information criterion, with the weight of the points."""
    points = compiled(problem.log_likelihood)(jnp.asarray(z), data)
    effective = float(data.information) * points.size
    likelihood = float(jnp.sum(data.information * points))
    return problem.n_parameters * np.log(effective) - 2.0 * likelihood
