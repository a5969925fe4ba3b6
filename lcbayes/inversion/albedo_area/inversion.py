"""Albedo-area distribution, shape cues and shape from a light curve of known attitude."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.errors import InputError
from lcbayes.core.progress import Silent
from lcbayes.core.reasons import Reason
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion import reasons
from lcbayes.inversion.albedo_area import bootstrap, cues, misfit
from lcbayes.inversion.albedo_area.distribution import (
    Distribution,
    Rows,
    grid,
    smooth,
    solve,
    typical,
)
from lcbayes.inversion.albedo_area.facets import Facets, explain
from lcbayes.inversion.albedo_area.kernel import LAMBERTIAN, Material, columns
from lcbayes.inversion.albedo_area.observed import Observed
from lcbayes.physics.attitude.laws import Attitude
from lcbayes.physics.bodies.closure import close, closure
from lcbayes.physics.bodies.minkowski import minkowski
from lcbayes.physics.bodies.polyhedron import Polyhedron

Floats = NDArray[np.float64]

OPEN = 0.1  # largest gap |Σ α n|/Σα of facets treated as a closed body
LOOSE = 0.2  # rms residual over mean flux above which the fit is poor, errors unknown
CHANGED = 0.1  # fraction of area changed for closure above which the shape is unreliable
FEWEST = 10  # least number of points
VAGUE = 0.5  # standard deviation over area above which a facet's area is unreliable
UNSEEN = 0.1  # fraction of directions never lit and seen above which the shape is unreliable


@dataclass(frozen=True)
class Inversion:
    """Result of `invert`.

    Attributes
    ----------
    seen : Observed
        Data, with estimated errors if the light curve has none.
    materials : sequence of Material
    on_grid : Distribution
        On the equal-area grid, once for each material, with the requested penalty.
    grid_sd : (n,) m² or None
        Bootstrap standard deviation of the areas on the grid.
    facets : Facets or None
        The few selected facets; None if the distribution was smoothed.
    draws : FacetDraws or None
        Bootstrap draws of the facets.
    cues : list of Cue
    gap : float
        |Σ α n|/Σα of the areas from which the shape is built.
    changed : float
        Σ |change|/Σα required for closure.
    shape : Polyhedron or None
        The convex body, for one albedo.
    finer_volume : float or None
        Volume of the body from the refined distribution, before facets were merged. Its difference
        from the volume of ``shape`` shows the effect of selecting few facets. None if the
        distribution was smoothed or is not closed.
    no_shape : str
        Reason if there is no shape.
    unseen : float
        Fraction of all directions that were never lit and seen at once.
    dof : int
        Number of points minus fitted parameters.
    reasons : list of Reason
        Reasons why the result is unreliable; empty if there are none.
    """

    seen: Observed
    materials: Sequence[Material]
    on_grid: Distribution
    grid_sd: Floats | None
    facets: Facets | None
    draws: bootstrap.FacetDraws | None
    cues: list[cues.Cue]
    gap: float
    changed: float
    shape: Polyhedron | None
    finer_volume: float | None
    no_shape: str
    unseen: float
    dof: int
    reasons: list[Reason] = field(default_factory=list)

    @property
    def best(self) -> Distribution:
        """The final solution: the few facets, or the smooth distribution."""
        return self.on_grid if self.facets is None else self.facets

    @property
    def rms(self) -> float:
        """Rms residual, relative to the mean flux of each curve."""
        mean = np.bincount(self.seen.curve, self.seen.flux) / np.bincount(self.seen.curve)
        mean = np.where(mean > 0, mean, np.mean(self.seen.flux))
        residual = (self.seen.flux - self.best.flux) / mean[self.seen.curve]
        return float(np.sqrt(np.mean(residual**2)))


def invert(
    curve: LightCurve,
    attitude: Attitude,
    materials: Sequence[Material] = (LAMBERTIAN,),
    *,
    n_normals: int = 400,
    smoothness: float = 0.0,
    cost: float | None = None,
    albedo: float = 1.0,
    n_bootstrap: int = 100,
    n_null: int = 199,
    seed: int = 0,
    progress: Silent | None = None,
) -> Inversion:
    """Albedo-area distribution, shape cues and convex shape of a light curve.

    Without smoothing, the distribution on the grid is reduced to the few facets that explain the
    data, and the shape is their convex body. With smoothing, the shape is that of the smooth
    distribution on the grid.

    Parameters
    ----------
    curve : LightCurve
    attitude : Attitude
        Assumed known. A wrong attitude gives a wrong body, often but not always with a poor fit.
    materials : sequence of Material
        Columns of Hall's eq. (11), for instance one diffuse and one specular.
    n_normals : int
        Number of normals of the grid.
    smoothness : float
        λ of `distribution.smooth`; 0 for bodies with edges, about 1 for asteroids.
    cost : float, optional
        Least reduction of χ² per facet; see `facets.few`. 0 keeps all facets.
    albedo : float
        Common albedo of all facets: areas of the shape are albedo-areas divided by it.
    n_bootstrap, n_null : int
        Number of resampled data sets, and of simulated bodies for each null hypothesis of the cues;
        0 skips the step.
    seed : int
    progress : Silent or Console

    Raises
    ------
    InputError

    References
    ----------
    Hall et al. 2007, sec. 3.
    """
    if not (n_normals >= 50 and smoothness >= 0.0 and albedo > 0.0):
        raise InputError(
            "give at least 50 normals, a smoothness that is not negative and a positive albedo"
        )
    if cost is not None and not cost >= 0.0:
        raise InputError(f"--facet-cost is {cost:g}; give a chi2 of 0 or more")
    if curve.n_obs < FEWEST:
        raise InputError(
            f"the light curve has {curve.n_obs} point(s); an albedo-area distribution needs at "
            f"least {FEWEST}, and a shape many more"
        )
    progress = progress or Silent()
    seen = Observed.of(curve, attitude)
    normals, which = grid(n_normals, materials)
    matrix = columns(seen, normals, which, materials)
    plain = solve(seen, normals, which, matrix)
    _check_lit(plain)
    if not seen.error_known:  # estimate the errors from the fit
        used = np.sum(plain.areas > 0) + np.sum(seen.free)
        dof = max(len(seen.flux) - used, len(seen.flux) // 2)
        seen = seen.with_error(seen.error * np.sqrt(max(plain.chi2, 1e-20) / dof))
        plain = solve(seen, normals, which, matrix, start=plain)
    penalties: list[Rows] = []
    on_grid = plain
    if smoothness > 0:
        penalties = [smooth(normals, which, smoothness, typical(seen, matrix))]
        on_grid = solve(seen, normals, which, matrix, penalties, start=plain)
    found = fine = None
    if smoothness == 0 or n_null > 0:
        progress.say("refining the grid to few facets")
        fine, found = explain(seen, plain, matrix, materials, cost)
    found_cues = []
    if found is not None and n_null > 0:
        with progress.stage("shape cues", 2 * n_null, "bodies") as track:
            found_cues = cues.find(seen, plain, matrix, found, materials, n_null, seed, track)
    if smoothness > 0:
        found = fine = None
    grid_sd = draws = None
    if n_bootstrap > 0:
        progress.say(f"resampling the data {n_bootstrap} times")
        weight = bootstrap.weights(seen, n_bootstrap, seed + 3)
        grid_sd = bootstrap.distributions(seen, on_grid, matrix, weight, penalties).std(axis=0)
        if found is not None:
            draws = bootstrap.facets(seen, found, materials, weight, albedo)
    best = on_grid if found is None else found
    gap = closure(best.normals, best.areas)
    lit = matrix.reshape(len(matrix), -1, n_normals).sum(axis=(0, 1)) > 0
    unseen = float(1.0 - lit.mean())
    shape, changed, no_shape = _shape(best, albedo, unseen)
    finer = None if fine is None else _shape(fine, albedo, unseen)[0]
    parameters = np.sum(best.areas > 0) * (1 if found is None else 3) + np.sum(seen.free)
    result = Inversion(
        seen,
        materials,
        on_grid,
        grid_sd,
        found,
        draws,
        found_cues,
        gap,
        changed,
        shape,
        None if finer is None else finer.volume,
        no_shape,
        unseen,
        max(int(len(seen.flux) - parameters), 1),
    )
    result.reasons.extend(_doubts(result, cost, seed))
    return result


def _check_lit(plain: Distribution) -> None:
    if not plain.areas.sum() > 0:
        raise InputError(
            "no facet, whatever way it faces, lowers the residuals: the flux is not positive"
        )


def _shape(
    best: Distribution, albedo: float, unseen: float
) -> tuple[Polyhedron | None, float, str]:
    """The body, the change of area required for closure, and the reason if there is no body."""
    gap = closure(best.normals, best.areas)
    if gap > OPEN:
        why = "so no convex body of one albedo has them"
        if unseen > 0:
            why = f"so albedos differ, or facets are missing: {reasons.unseen_part(unseen)}"
        return (
            None,
            0.0,
            (f"facets do not close: |sum(A n)| / sum(A) = {gap:.2f} exceeds {OPEN}, {why}"),
        )
    try:
        closed = close(best.normals, best.areas)
        body = minkowski(best.normals, closed / albedo)
    except InputError as fault:
        return None, 0.0, str(fault)
    return body, float(np.sum(np.abs(closed - best.areas)) / best.areas.sum()), ""


def _doubts(result: Inversion, cost: float | None, seed: int) -> list[Reason]:
    """Reasons why the result is unreliable."""
    out = _misfits(result, cost, seed)
    used = len(result.seen.flux) - result.dof
    if result.facets is not None:
        if used > result.dof:
            out.append(reasons.too_many_parameters(used, len(result.seen.flux)))
        vague = int(np.sum(result.facets.area_sd > VAGUE * result.facets.areas))
        if vague:
            out.append(reasons.areas_undetermined(vague, len(result.facets.areas), VAGUE))
    if result.changed > CHANGED:
        out.append(reasons.not_closed(result.changed))
    if result.unseen > UNSEEN:
        out.append(reasons.directions_unseen(result.unseen))
    return out


def _misfits(result: Inversion, cost: float | None, seed: int) -> list[Reason]:
    """Reasons from the residuals."""
    out = []
    lambertian = tuple(result.materials) == (LAMBERTIAN,)
    body = reasons.convex_body(" and ".join(map(str, result.materials)), lambertian)
    chi2 = result.best.chi2
    p_value = misfit.chi2_p_value(chi2, result.dof)
    misfits = result.seen.error_known and p_value < misfit.LEVEL
    if misfits:
        out.append(reasons.misfit(chi2 / result.dof, p_value, body))
    if not result.seen.error_known and result.rms > LOOSE:
        out.append(reasons.large_residuals(result.rms, body))
    by_geometry = misfit.geometry_p_value(result.seen, result.best.flux, seed)
    if by_geometry < misfit.GEOMETRY_LEVEL:
        out.append(reasons.residuals_follow_geometry(by_geometry))
    if result.facets is not None and (misfits or by_geometry < misfit.GEOMETRY_LEVEL):
        cost = 3.0 * float(np.log(len(result.seen.flux))) if cost is None else cost
        ghosts = misfit.doubtful(result.facets, result.dof, cost)
        if len(ghosts):
            out.append(reasons.insignificant_facets(result.facets.areas[ghosts]))
    return out
