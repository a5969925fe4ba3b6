"""Albedo-area distribution, shape cues and shape from a light curve of known attitude."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.errors import InputError
from lcbayes.core.progress import Silent
from lcbayes.core.reasons import Finding
from lcbayes.core.threads import single_threaded_blas
from lcbayes.data.lightcurve import LightCurve
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
    reasons : list of Finding
        Findings against the result; empty if there are none.
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
    reasons: list[Finding] = field(default_factory=list)

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


@dataclass(frozen=True)
class InversionSettings:
    """Settings of `invert`.

    Parameters
    ----------
    n_normals : normals of the grid, at least 50
    smoothness : λ of `distribution.smooth`; 0 for bodies with edges, about 1 for asteroids
    cost : reduction of χ² that a facet must bring, see `facets.explain`; 0 keeps every facet,
        None takes 3 ln N of the points
    albedo : of all facets; areas of the shape are albedo-areas divided by it
    n_bootstrap : resampled data sets; 0 omits the resampling
    n_null : simulated bodies for each null distribution of the cues; 0 omits the cues
    seed : of the resampling and of the simulated bodies

    Raises
    ------
    InputError
        A value lies outside its range.
    """

    n_normals: int = 400
    smoothness: float = 0.0
    cost: float | None = None
    albedo: float = 1.0
    n_bootstrap: int = 100
    n_null: int = 199
    seed: int = 0

    def __post_init__(self) -> None:
        if not (self.n_normals >= 50 and self.smoothness >= 0.0 and self.albedo > 0.0):
            raise InputError(
                "give at least 50 normals, a smoothness that is not negative and a positive albedo"
            )
        if self.cost is not None and not self.cost >= 0.0:
            raise InputError(f"--facet-cost is {self.cost:g}; give a chi2 of 0 or more")


def invert(
    curve: LightCurve,
    attitude: Attitude,
    materials: Sequence[Material] = (LAMBERTIAN,),
    settings: InversionSettings = InversionSettings(),
    progress: Silent | None = None,
) -> Inversion:
    """Albedo-area distribution, shape cues and convex shape of a light curve.

    Without smoothing, the distribution on the grid is refined to the facets that explain the data,
    and the shape is the convex body of these. With smoothing, the shape is that of the smooth
    distribution on the grid.

    Parameters
    ----------
    curve : LightCurve
    attitude : Attitude
        Assumed to be exact: a wrong attitude gives a wrong body, and usually a poor fit.
    materials : sequence of Material
        Columns of Hall's eq. (11), for instance one diffuse and one specular.
    settings : InversionSettings
    progress : Silent or Console

    Raises
    ------
    InputError
        The light curve has too few points, or shows no light.

    References
    ----------
    Hall et al. 2007, sec. 3.
    """
    if curve.n_obs < FEWEST:
        raise InputError(
            f"the light curve has {curve.n_obs} point(s); an albedo-area distribution needs at "
            f"least {FEWEST}, and a shape many more"
        )
    with single_threaded_blas:  # thousands of small systems: waking threads takes longer
        return _inverted(Observed.of(curve, attitude), materials, settings, progress or Silent())


def _inverted(
    seen: Observed, materials: Sequence[Material], settings: InversionSettings, progress: Silent
) -> Inversion:
    normals, which = grid(settings.n_normals, materials)
    seen, matrix, plain = _solved(seen, normals, which, materials)
    penalties: list[Rows] = []
    on_grid = plain
    if settings.smoothness > 0:
        penalties = [smooth(normals, which, settings.smoothness, typical(seen, matrix))]
        on_grid = solve(seen, normals, which, matrix, penalties, start=plain)
    fine, facets, all_cues = _facets(seen, plain, matrix, materials, settings, progress)
    grid_sd = draws = None
    if settings.n_bootstrap > 0:
        progress.say(f"resampling the data {settings.n_bootstrap} times")
        weight = bootstrap.weights(seen, settings.n_bootstrap, settings.seed + 3)
        grid_sd = bootstrap.distributions(seen, on_grid, matrix, weight, penalties).std(axis=0)
        if facets is not None:
            draws = bootstrap.facets(seen, facets, materials, weight, settings.albedo)
    best = on_grid if facets is None else facets
    lit = matrix.reshape(len(matrix), -1, settings.n_normals).sum(axis=(0, 1)) > 0
    unseen = float(1.0 - lit.mean())
    shape, changed, no_shape = _shape(best, settings.albedo, unseen)
    finer = None if fine is None else _shape(fine, settings.albedo, unseen)[0]
    parameters = np.sum(best.areas > 0) * (1 if facets is None else 3) + np.sum(seen.free)
    result = Inversion(
        seen,
        materials,
        on_grid,
        grid_sd,
        facets,
        draws,
        all_cues,
        closure(best.normals, best.areas),
        changed,
        shape,
        None if finer is None else finer.volume,
        no_shape,
        unseen,
        max(int(len(seen.flux) - parameters), 1),
    )
    result.reasons.extend(_doubts(result, settings.cost, settings.seed))
    return result


def _solved(
    seen: Observed, normals: Floats, which: NDArray[np.integer], materials: Sequence[Material]
) -> tuple[Observed, Floats, Distribution]:
    """The distribution on the grid; errors that are not given are estimated from its residuals."""
    matrix = columns(seen, normals, which, materials)
    plain = solve(seen, normals, which, matrix)
    _check_lit(plain)
    if not seen.error_known:
        used = np.sum(plain.areas > 0) + np.sum(seen.free)
        dof = max(len(seen.flux) - used, len(seen.flux) // 2)
        seen = seen.with_error(seen.error * np.sqrt(max(plain.chi2, 1e-20) / dof))
        plain = solve(seen, normals, which, matrix, start=plain)
    return seen, matrix, plain


def _facets(
    seen: Observed,
    plain: Distribution,
    matrix: Floats,
    materials: Sequence[Material],
    settings: InversionSettings,
    progress: Silent,
) -> tuple[Distribution | None, Facets | None, list[cues.Cue]]:
    """The refined distribution and its facets, where not smoothed; the cues, where asked for."""
    if settings.smoothness > 0 and settings.n_null == 0:
        return None, None, []
    progress.say("refining the grid to few facets")
    fine, facets = explain(seen, plain, matrix, materials, settings.cost)
    all_cues: list[cues.Cue] = []
    if settings.n_null > 0:
        n_null, seed = settings.n_null, settings.seed
        with progress.stage("shape cues", 2 * n_null, "bodies") as track:
            all_cues = cues.find(seen, plain, matrix, facets, materials, n_null, seed, track)
    if settings.smoothness > 0:
        return None, None, all_cues
    return fine, facets, all_cues


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
            why = f"so albedos differ, or facets are missing: {100 * unseen:.0f} % of all "
            why += "directions were never lit and seen at once"
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


def _doubts(result: Inversion, cost: float | None, seed: int) -> list[Finding]:
    """Findings against the result."""
    out = _misfits(result, cost, seed)
    used = len(result.seen.flux) - result.dof
    if result.facets is not None:
        if used > result.dof:
            values = {"fitted": used, "points": len(result.seen.flux), "others": "facets"}
            out.append(Finding("too-many-parameters", values))
        vague = int(np.sum(result.facets.area_sd > VAGUE * result.facets.areas))
        if vague:
            values = {"count": vague, "facets": len(result.facets.areas), "percent": 100 * VAGUE}
            out.append(Finding("areas-undetermined", values))
    if result.changed > CHANGED:
        out.append(Finding("not-closed", {"percent": 100 * result.changed}))
    if result.unseen > UNSEEN:
        out.append(Finding("directions-unseen", {"percent": 100 * result.unseen}))
    return out


def _misfits(result: Inversion, cost: float | None, seed: int) -> list[Finding]:
    """Findings from the residuals."""
    out = []
    lambertian = tuple(result.materials) == (LAMBERTIAN,)
    body = {
        "materials": " and ".join(map(str, result.materials)),
        "remedy": "another-law" if lambertian else "",
    }
    chi2 = result.best.chi2
    p_value = misfit.chi2_p_value(chi2, result.dof)
    misfits = result.seen.error_known and p_value < misfit.LEVEL
    if misfits:
        values = {"ratio": chi2 / result.dof, "p_value": p_value} | body
        out.append(Finding("misfit", values))
    if not result.seen.error_known and result.rms > LOOSE:
        out.append(Finding("large-residuals", {"percent": 100 * result.rms} | body))
    by_geometry = misfit.geometry_p_value(result.seen, result.best.flux, seed)
    if by_geometry < misfit.GEOMETRY_LEVEL:
        out.append(Finding("residuals-follow-geometry", {"p_value": by_geometry}))
    if result.facets is not None and (misfits or by_geometry < misfit.GEOMETRY_LEVEL):
        cost = 3.0 * float(np.log(len(result.seen.flux))) if cost is None else cost
        ghosts = misfit.doubtful(result.facets, result.dof, cost)
        if len(ghosts):
            sizes = ", ".join(f"{a:.3g}" for a in sorted(result.facets.areas[ghosts]))
            out.append(Finding("insignificant-facets", {"areas": sizes}))
    return out
