"""Orientation of a single large facet from its edge crossing during a pass.

During a pass of a low satellite, a facet may come into view or into sunlight, or leave them. The
light curve then brightens or dims with a kink, which constrains the facet's normal n in the axes of
an attitude law: n·o = 0 at a change of visibility, or n·s = 0 at a change of illumination. The flux
in every pass is f(t) = b(t) + α ⟨n·o⟩⟨n·s⟩/π. Here b is smooth (a cubic in time and the phase law
of a Lambertian sphere), and α ≥ 0. For every n on the sphere, b and α follow from linear least
squares. D(n) is the decrease of χ² due to the facet, and the normals within χ²₂ of its maximum form
the region. Two sites distinguish the two kinds of change: a change of illumination is simultaneous
at both sites, whereas a change of visibility is not.

References
----------
Hall et al. 2007, sec. 4.3 and fig. 2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from lcbayes.core.errors import InputError
from lcbayes.core.reasons import Finding
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.separated.reduced import Floats, Ints, Reduced, in_body, reduce, turns
from lcbayes.modelling.ephemeris import ephemeris
from lcbayes.physics.attitude.laws import Attitude

DEGREE = 3  # of the polynomial in time for the rest of the body
CELLS = (288, 224)  # of the sphere in azimuth and cosine, equal areas; spacing 1.25 deg
COARSE = (144, 112)  # grid for the false-alarm probability
MOST_CELLS, LEVELS, CHUNK = 2500, 7, 4000  # cells subdivided at once, levels; rows at a time
KEPT = (0.3, 0.8, 0.95, 0.99)  # fraction of the largest D for subdivision, by level
MIN_REGION_CELLS = 150  # cells in the region that end the refinement
REGION = 0.9
NO_EDGE, MISFIT, KNOWN, SURE, LEAST_SHARE = 0.01, 1e-3, 0.15, 0.95, 0.1
LEAST_SWEEP_DEG, MIN_POINTS = 20.0, 20
KINDS = ("visibility", "illumination", "both", "none")


@dataclass(frozen=True)
class Edge:
    """A crossing of the facet's edge in a pass.

    Attributes
    ----------
    one_pass : index of the pass
    site : observing site
    t, error : s
        Time of the crossing for the best normals, and the standard deviation over the region.
    kind : "visibility" or "illumination"
    brightens : bool
    """

    one_pass: int
    site: str
    t: float
    error: float
    kind: str
    brightens: bool


@dataclass(frozen=True)
class SingleFacet:
    """Result for the facet.

    Attributes
    ----------
    law : name of the attitude law in whose body axes normals are given
    normal : (3,)
        Best normal.
    albedo_area : m²
        α for the best normal; NaN if every curve has its own scale.
    share : of the facet in the flux where it is brightest
    normals, fall : (C, 3), (C,)
        Normals of the cells about the region, and their D.
    cell : sr
    region : (C,) bool
        Cells that contain the normal with 90 % probability.
    kind : dict
        Probability of each of `KINDS`.
    p_value : probability that noise alone gives a D at least as large anywhere
    chi2, dof : of the best fit
    edges : by pass
    model, smooth : (T,)
        Best fit, and its part without the facet, in the order of ``seen``.
    seen : Reduced
    reasons : why the result is unreliable; empty if there are no problems
    """

    law: str
    normal: Floats
    albedo_area: float
    share: float
    normals: Floats
    fall: Floats
    cell: float
    region: NDArray[np.bool_]
    kind: dict[str, float]
    p_value: float
    chi2: float
    dof: int
    edges: list[Edge]
    model: Floats
    smooth: Floats
    seen: Reduced
    reasons: list[Finding]

    @property
    def area_sr(self) -> float:
        """Area of the region, sr."""
        return float(self.region.sum() * self.cell)

    @property
    def radius_deg(self) -> float:
        """Largest angle from the best normal to one in the region."""
        cosine = np.clip(self.normals[self.region] @ self.normal, -1.0, 1.0)
        return float(np.degrees(np.arccos(cosine.min())))


@dataclass(frozen=True)
class _Problem:
    """Whitened data with the smooth component projected out."""

    sun: Floats
    obs: Floats
    group: Ints
    error: Floats
    basis: Floats  # (T, K) orthonormal columns of the smooth component
    target: Floats  # (T,) whitened flux without the smooth component

    def columns(self, normals: Floats) -> Floats:
        """Whitened kernels (C, T) before projection."""
        lit, seen = (np.maximum(normals @ v.T, 0.0) for v in (self.sun, self.obs))
        return lit * seen / np.pi / self.error

    def scores(self, normals: Floats, targets: Floats) -> Floats:
        """D (C, S) for targets (T, S): Σ over groups of (max 0, t)²."""
        if len(normals) > CHUNK:
            parts = [normals[i : i + CHUNK] for i in range(0, len(normals), CHUNK)]
            return np.concatenate([self.scores(part, targets) for part in parts])
        rows = self.columns(normals)
        total = np.zeros((len(normals), targets.shape[1]))
        for g in range(int(self.group.max()) + 1):
            mine = np.where(self.group == g, rows, 0.0)
            mine = mine - (mine @ self.basis) @ self.basis.T
            length = np.linalg.norm(mine, axis=1)
            # for a facet that is never lit and seen, only rounding errors remain
            good = length > 1e-6 * np.maximum(np.linalg.norm(rows, axis=1), 1e-300)
            score = (mine @ targets) / np.where(good, length, np.inf)[:, None]
            total += np.maximum(score, 0.0) ** 2
        return total


def single_facet(
    curve: LightCurve, law: Attitude, *, n_nulls: int = 199, seed: int = 0
) -> SingleFacet:
    """Orientation of a large facet from the brightening or dimming at its edge crossing.

    Parameters
    ----------
    curve : LightCurve
        One or several passes from one or several sites, with errors.
    law : the assumed attitude of the satellite
    n_nulls : number of noise curves for the false-alarm probability

    Raises
    ------
    InputError
        The curve has no errors, too few points in every pass, or no orbit that the law requires.
    """
    if n_nulls < 99:
        raise InputError(f"n_nulls is {n_nulls}; expected 99 or more")
    seen = reduce(curve)
    site = curve.site[seen.row]
    keep = np.bincount(seen.one_pass)[seen.one_pass] >= MIN_POINTS
    if not keep.any():
        raise InputError(
            f"no pass has {MIN_POINTS} points (the longest has {np.bincount(seen.one_pass).max()})"
            "; give a pass that is sampled more densely"
        )
    seen, site = seen.at(np.flatnonzero(keep)), site[keep]
    parts = in_body(turns(law, ephemeris(curve), seen), seen)
    sun, obs = parts[0]
    problem, smooth_columns = _problem(seen, sun, obs)
    normals, fall, cell = _refined(problem)
    best = normals[np.argmax(fall)]
    region = fall >= fall.max() - stats.chi2.ppf(REGION, 2)
    coarse, _ = _cells(COARSE)
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal((len(seen.t), n_nulls))
    noise -= problem.basis @ (problem.basis.T @ noise)
    null = problem.scores(coarse, noise).max(axis=0)
    mine = problem.scores(coarse, problem.target[:, None]).max()
    p = (1 + np.sum(null >= mine)) / (1 + n_nulls)
    model, smooth, alpha = _fit(problem, smooth_columns, seen, best)
    n_groups = len(np.unique(seen.group))
    dof = len(seen.t) - problem.basis.shape[1] - n_groups - 2
    chi2 = float(np.sum(((seen.flux - model) / seen.error) ** 2))
    weight = np.exp(0.5 * (fall - fall.max()))
    kind = _kinds(normals, weight, sun, obs, seen)
    edges = _edges(normals[region], weight[region], best, sun, obs, seen, site)
    own = model - smooth
    k = np.argmax(own)  # elsewhere the total may be near zero, and the ratio meaningless
    share = min(1.0, float(own[k] / max(model[k], seen.error[k])))
    area = alpha if not np.any(curve.free_scale) else np.nan
    result = SingleFacet(
        law.name,
        best,
        area,
        share,
        normals,
        fall,
        cell,
        region,
        kind,
        float(p),
        chi2,
        dof,
        edges,
        model,
        smooth,
        seen,
        [],
    )
    result.reasons.extend(_reasons(result, obs))
    return result


def _reasons(result: SingleFacet, obs: Floats) -> list[Finding]:
    """Conditions that are not met."""
    out = []
    if result.p_value > NO_EDGE:
        out.append(Finding("no-edge", {"p_value": result.p_value}))
    sweep = max(
        np.degrees(np.arccos(np.clip((obs[rows] @ obs[rows].T).min(), -1.0, 1.0)))
        for i in np.unique(result.seen.one_pass)
        for rows in [np.flatnonzero(result.seen.one_pass == i)]
    )
    if sweep < LEAST_SWEEP_DEG:
        values = {"sweep_deg": float(sweep), "least_deg": LEAST_SWEEP_DEG}
        out.append(Finding("narrow-sweep", values))
    if stats.chi2.sf(result.chi2, result.dof) < MISFIT:
        out.append(Finding("one-facet-misfit", {"chi2": result.chi2, "dof": result.dof}))
    if result.share < LEAST_SHARE:
        out.append(Finding("small-share", {"share": result.share}))
    if result.area_sr > KNOWN * 4.0 * np.pi:
        out.append(Finding("normal-unconstrained", {"part": result.area_sr / (4 * np.pi)}))
    if result.kind["none"] > 1.0 - SURE:
        out.append(Finding("always-seen", {"probability": result.kind["none"]}))
    return out


def _problem(seen: Reduced, sun: Floats, obs: Floats) -> tuple[_Problem, Floats]:
    """The least-squares problem, and the unwhitened columns of the smooth component, (T, K)."""
    phase = np.arccos(np.clip(np.sum(seen.sun * seen.obs, axis=1), -1.0, 1.0))
    sphere = np.sin(phase) + (np.pi - phase) * np.cos(phase)
    columns = []
    for i in np.unique(seen.one_pass):
        here = seen.one_pass == i
        t = seen.t[here]
        x = 2.0 * (t - t[0]) / max(t[-1] - t[0], 1e-9) - 1.0
        for values in (*np.polynomial.legendre.legvander(x, DEGREE).T, sphere[here]):
            column = np.zeros(len(seen.t))
            column[here] = values
            columns.append(column)
    rest = np.array(columns).T
    u, s, _ = np.linalg.svd(rest / seen.error[:, None], full_matrices=False)
    basis = u[:, s > 1e-10 * s[0]]
    target = seen.flux / seen.error
    target = target - basis @ (basis.T @ target)
    return _Problem(sun, obs, seen.group, seen.error, basis, target), rest


def _cells(shape: tuple[int, int]) -> tuple[Floats, Floats]:
    """Centres of cells of equal area, and their corners (φ, g) at the lower edge."""
    size = np.array([2 * np.pi, 2.0]) / shape
    phi, g = np.meshgrid(size[0] * np.arange(shape[0]), -1.0 + size[1] * np.arange(shape[1]))
    corner = np.stack([phi.ravel(), g.ravel()], axis=1)
    return _middle(corner, size), corner


def _middle(corner: Floats, size: Floats) -> Floats:
    phi, g = (corner + 0.5 * size).T
    s = np.sqrt(1 - g**2)
    return np.stack([s * np.cos(phi), s * np.sin(phi), g], axis=1)


def _refined(problem: _Problem) -> tuple[Floats, Floats, float]:
    """Normals of cells about the largest D, their D, and the area of a cell (sr).

    Cells in which D may approach its maximum are divided into four, until the region has enough
    cells.
    """
    normals, corner = _cells(CELLS)
    size = np.array([2 * np.pi, 2.0]) / CELLS
    target = problem.target[:, None]
    fall = problem.scores(normals, target)[:, 0]
    level = 0
    while level < LEVELS and np.sum(fall >= fall.max() - 4.6) < MIN_REGION_CELLS:
        # D over its maximum is a squared correlation of kernels, independent of the noise
        share = KEPT[min(level, len(KEPT) - 1)]
        kept = np.argsort(-fall)[:MOST_CELLS]
        kept = kept[fall[kept] >= min(share * fall.max(), fall.max() - 30.0)]
        level += 1
        size = 0.5 * size
        corner = (corner[kept][:, None] + size * [[0, 0], [0, 1], [1, 0], [1, 1]]).reshape(-1, 2)
        normals = _middle(corner, size)
        fall = problem.scores(normals, target)[:, 0]
    return normals, fall, float(np.prod(size))


def _fit(
    problem: _Problem, rest: Floats, seen: Reduced, normal: Floats
) -> tuple[Floats, Floats, float]:
    """Best fit for a normal: the total, the smooth part, and the largest α."""
    kernel = problem.columns(normal[None])[0] * seen.error
    groups = np.unique(seen.group)
    own = np.stack([np.where(seen.group == g, kernel, 0.0) for g in groups], axis=1)
    whitened = own / seen.error[:, None]
    left = whitened - problem.basis @ (problem.basis.T @ whitened)
    length2 = np.maximum(np.sum(left**2, axis=0), 1e-300)
    alpha = np.maximum(left.T @ problem.target / length2, 0.0)  # groups have no common points
    bright = own @ alpha
    rows = rest / seen.error[:, None]
    fitted, *_ = np.linalg.lstsq(rows, (seen.flux - bright) / seen.error, rcond=1e-10)
    smooth = rest @ fitted
    return smooth + bright, smooth, float(alpha.max())


def _switches(normals: Floats, sun: Floats, obs: Floats, seen: Reduced):
    """Changes of the facet of each normal between lit and seen or not, from point k to k + 1.

    Returns (C, T−1) arrays: whether there is a change, whether it is one of visibility, whether the
    facet brightens, and the time of the change.
    """
    mu0, mu = normals @ sun.T, normals @ obs.T
    on = (mu0 > 0) & (mu > 0)
    switch = (on[:, 1:] != on[:, :-1]) & (np.diff(seen.one_pass) == 0)
    low0 = np.minimum(mu0[:, 1:], mu0[:, :-1]) <= 0
    low = np.minimum(mu[:, 1:], mu[:, :-1]) <= 0
    by_view = low & ~low0
    before = np.where(by_view, mu[:, :-1], mu0[:, :-1])
    after = np.where(by_view, mu[:, 1:], mu0[:, 1:])
    step = after - before
    part = np.clip(-before / np.where(step == 0, 1.0, step), 0.0, 1.0)
    return switch, by_view, on[:, 1:] > on[:, :-1], seen.t[:-1] + part * np.diff(seen.t)


def _kinds(
    normals: Floats, weight: Floats, sun: Floats, obs: Floats, seen: Reduced
) -> dict[str, float]:
    """Probability of each kind of change, over the normals."""
    switch, by_view, _, _ = _switches(normals, sun, obs, seen)
    view, light = (switch & by_view).any(axis=1), (switch & ~by_view).any(axis=1)
    which = {
        "visibility": view & ~light,
        "illumination": light & ~view,
        "both": view & light,
        "none": ~view & ~light,
    }
    return {name: float(weight[rows].sum() / weight.sum()) for name, rows in which.items()}


def _edges(
    normals: Floats,
    weight: Floats,
    best: Floats,
    sun: Floats,
    obs: Floats,
    seen: Reduced,
    site: NDArray[np.str_],
) -> list[Edge]:
    """The edges that the best normal crosses, with the spread of their times over the region."""
    switch, by_view, up, when = _switches(np.concatenate([best[None], normals]), sun, obs, seen)
    out = []
    for k in np.flatnonzero(switch[0]):
        here = seen.one_pass[:-1] == seen.one_pass[k]
        like = switch[1:] & here & (by_view[1:] == by_view[0, k]) & (up[1:] == up[0, k])
        rows = np.flatnonzero(like.any(axis=1))
        times = when[1 + rows, np.argmax(like[rows], axis=1)]
        spread = np.nan
        if len(rows):
            middle = np.average(times, weights=weight[rows])
            spread = float(np.sqrt(np.average((times - middle) ** 2, weights=weight[rows])))
        out.append(
            Edge(
                int(seen.one_pass[k]),
                str(site[k]),
                float(when[0, k]),
                spread,
                "visibility" if by_view[0, k] else "illumination",
                bool(up[0, k]),
            )
        )
    return out
