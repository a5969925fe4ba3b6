"""Does the model explain the data: χ² by the law of noise, against the parameters the data set."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri_exp
from scipy.stats import chi2 as chi2_distribution

from lcbayes.core.jax_setup import jnp
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.likelihood import Law
from lcbayes.modelling.problem import Problem, compiled

Floats = NDArray[np.float64]

MIN_FIT = 1e-6  # probability of a larger chi2 below which the model does not explain the data


class Misfit(NamedTuple):
    """How far the data are from the best fit.

    Attributes
    ----------
    chi2 : float or None
        See `chi2`; None where the errors of the data are not known.
    dof : float
        See `degrees_of_freedom`.
    law : Law
        Of the noise.
    """

    chi2: float | None
    dof: float
    law: Law

    @property
    def explained(self) -> bool:
        """Whether the data may come from the model, as far as is known."""
        return self.chi2 is None or not chi2_distribution.sf(self.chi2, self.dof) < MIN_FIT

    @property
    def words(self) -> str:
        """What chi2 is, and what may lower it, of data that are not explained."""
        gaussian = self.law == "gaussian"
        of = "" if gaussian else f" of the residuals, as normal quantiles by --noise {self.law},"
        cure = "try more facets" + (
            ", another law, or --noise student-t" if gaussian else " or another law"
        )
        return f"chi2{of} is {self.chi2:.0f} for {self.dof:g} degrees of freedom; {cure}"


def measure(problem: Problem, data: Epochs, rows: Floats) -> Misfit:
    """Of that of the points z (n, D) which fits best."""
    fits = [chi2(problem, z, data) for z in rows]
    best = int(np.argmin(np.nan_to_num(fits, nan=np.inf)))
    # scatter that is inferred beside the errors makes any model fit them
    judged = data.has_error and not {"sigma", "log_sigma"} & set(problem.names)
    dof = degrees_of_freedom(problem, rows[best], data)
    return Misfit(fits[best] if judged else None, round(dof, 1), problem.law)


def chi2(problem: Problem, z: Floats, data: Epochs) -> float:
    """Σ Φ⁻¹(F(y))², F the law of noise about the model: of squared standard normals for every law.

    For Gaussian noise that is Σ ((y − m)/σ)². A heavy tail is taken for what it is: a point at four
    scales of Student's t of 4 degrees of freedom is as rare as one at 2.4 standard deviations.
    Points of a pass, where they share an offset, are each given the earlier ones.
    """
    tails = np.asarray(compiled(problem.log_tail)(jnp.asarray(z), data))
    return float(np.sum(ndtri_exp(tails) ** 2))


def degrees_of_freedom(problem: Problem, z: Floats, data: Epochs) -> float:
    """Points less the parameters that they set, n − tr[(F − F₀) F⁻¹]; n where less than 1 is left.

    F is the information on z with the brightness, F₀ without it: of the prior and of all else that
    is conditioned on. A parameter counts as 1 where the data tell it and as 0 where the prior does,
    as the length of the vector behind a direction. The χ² of a fit is never larger than that of
    the truth, so that n, where nothing is left, errs on the side of the model.

    References
    ----------
    Spiegelhalter et al. 2002, JRSS B 64, 583, sec. 4 (the effective number of parameters).
    """
    fisher = compiled(problem.fisher)
    whole = fisher(jnp.asarray(z), data)
    without = fisher(jnp.asarray(z), replace(data, information=0.0 * data.information))
    unit = jnp.sqrt(jnp.diagonal(whole))
    unit = jnp.outer(unit, unit)  # coordinates may differ in scale by any factor
    told = jnp.linalg.pinv(whole / unit, hermitian=True) * ((whole - without) / unit)
    n = float(data.t.size)
    left = n - float(jnp.sum(told))
    return left if left >= 1.0 else n
