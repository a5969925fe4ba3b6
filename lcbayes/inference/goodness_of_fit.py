"""Goodness of fit: χ² under the noise law, against the effective degrees of freedom."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri_exp
from scipy.stats import chi2 as chi2_distribution

from lcbayes.core.jax_setup import jnp
from lcbayes.inference.misfit_tests import Examination, errors_known
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.likelihood import Law
from lcbayes.modelling.problem import Problem, compiled

Floats = NDArray[np.float64]

MIN_FIT = 1e-6  # p-value of chi2 below which the model does not explain the data


class Misfit(NamedTuple):
    """Misfit between the data and the best fit.

    Attributes
    ----------
    chi2 : float or None
        See `chi2`; None if the errors of the data are unknown.
    dof : float
        See `degrees_of_freedom`.
    law : Law
        Noise law.
    information : float
        Independent points per point; below 1 for correlated noise.
    examination : Examination or None
        Tests of the residuals; without them, chi2 alone decides.
    facets : bool
        Whether the body is of facets, of which there may be more.
    """

    chi2: float | None
    dof: float
    law: Law
    information: float = 1.0
    examination: Examination | None = None
    facets: bool = True

    @property
    def other(self) -> str:
        """A model that may explain the data."""
        return "more facets" if self.facets else "another body"

    @property
    def explained(self) -> bool:
        """Whether the data are consistent with the model, as far as is known."""
        if self.chi2 is None:
            return True
        if self.examination is not None:
            return not self.examination.refused
        share = self.information
        return not chi2_distribution.sf(share * self.chi2, share * self.dof) < MIN_FIT

    @property
    def words(self) -> str:
        """The value of chi2 and possible remedies, for data that the model does not explain."""
        gaussian = self.law == "gaussian"
        of = "" if gaussian else f" of the residuals, as normal quantiles by --noise {self.law},"
        cure = f"try {self.other}" + (
            ", another law, or --noise student-t" if gaussian else " or another law"
        )
        return f"chi2{of} is {self.chi2:.0f} for {self.dof:g} degrees of freedom; {cure}"


def measure(
    problem: Problem,
    data: Epochs,
    rows: Floats,
    examination: Examination | None = None,
) -> Misfit:
    """Misfit of the best-fitting point among z (n, D)."""
    fits = [chi2(problem, z, data) for z in rows]
    best = int(np.argmin(np.nan_to_num(fits, nan=np.inf)))
    dof = degrees_of_freedom(problem, rows[best], data)
    share = min(1.0, float(np.mean(np.asarray(data.information))))
    chi2_known = fits[best] if errors_known(problem, data) else None
    facets = any(name.endswith("normals_base") for name in problem.names)
    return Misfit(chi2_known, round(dof, 1), problem.law, share, examination, facets)


def chi2(problem: Problem, z: Floats, data: Epochs) -> float:
    """Σ Φ⁻¹(F(y))², with F the distribution of the noise about the model.

    The sum is one of squared standard normals for every noise law. For Gaussian noise it is
    Σ ((y − m)/σ)². Heavy tails are accounted for: a point at four scales of Student's t with 4
    degrees of freedom is as rare as a Gaussian point at 2.4 standard deviations. If the points of a
    pass share an offset, each point is conditioned on the earlier ones.
    """
    tails = np.asarray(compiled(problem.log_tail)(jnp.asarray(z), data))
    return float(np.sum(ndtri_exp(tails) ** 2))


def degrees_of_freedom(problem: Problem, z: Floats, data: Epochs) -> float:
    """Number of points minus effective parameters, n − tr[(F − F₀) F⁻¹]; n if that is below 1.

    F is the information on z with the brightness data and F₀ without them, that is, from the prior
    and all other conditions. A parameter counts as 1 if the data determine it and as 0 if the prior
    does. An example of the latter is the length of the vector that represents a direction. The χ²
    of a fit never exceeds that of the truth, so the fallback n favours the model.

    References
    ----------
    Spiegelhalter et al. 2002, JRSS B 64, 583, sec. 4 (the effective number of parameters).
    """
    fisher = compiled(problem.fisher)
    whole = fisher(jnp.asarray(z), data)
    without = fisher(jnp.asarray(z), replace(data, information=0.0 * data.information))
    unit = jnp.sqrt(jnp.diagonal(whole))
    unit = jnp.outer(unit, unit)  # the scales of coordinates may differ by any factor
    estimated = jnp.linalg.pinv(whole / unit, hermitian=True) * ((whole - without) / unit)
    n = float(data.t.size)
    left = n - float(jnp.sum(estimated))
    return left if left >= 1.0 else n
