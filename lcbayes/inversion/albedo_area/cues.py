"""Shape cues from an albedo-area distribution, each with a statistic and a p-value."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.progress import Silent, Track
from lcbayes.inversion.albedo_area import nulls
from lcbayes.inversion.albedo_area.distribution import Distribution
from lcbayes.inversion.albedo_area.facets import Facets
from lcbayes.inversion.albedo_area.kernel import Material
from lcbayes.inversion.albedo_area.maps import BAND, CAP, HEAVY, Maps
from lcbayes.inversion.albedo_area.observed import Observed

Floats = NDArray[np.float64]

SIGNIFICANT = 0.05
ANGLES = (90.0, 60.0, 45.0)
BODIES = {90.0: "a box or a prism", 60.0: "a hexagonal prism", 45.0: "an octagonal prism"}
ANGLE_SD = 3.0  # degrees; tolerance of an angle
ALONG = 5.0  # degrees; tolerance for opposite facets
SMALL = 0.03  # least share of the area of a facet used for angles
ANGLE_DRAWS = 1999
DISTINCT = 12  # most facets of a body whose angles are tested without a distinct direction
WELL_MEASURED = 5.0  # least ratio of area to standard deviation of a facet counted among them


@dataclass(frozen=True)
class Cue:
    """Test of one property of a body.

    Attributes
    ----------
    name : "clusters", "arc", "uniform", "angle-90", "angle-60" or "angle-45"
    statistic : float
    p_value : float
        Probability of a statistic at least as large under ``null``, from n simulations:
        (1 + number at least as large)/(1 + n).
    null : str
        Null hypothesis in words.
    words : str
        Result in words.
    details : mapping
    """

    name: str
    statistic: float
    p_value: float
    null: str
    words: str
    details: Mapping[str, Any] = field(default_factory=dict)

    @property
    def significant(self) -> bool:
        return self.p_value <= SIGNIFICANT


def find(
    seen: Observed,
    distribution: Distribution,
    matrix: Floats,
    facets: Facets,
    materials: Sequence[Material],
    n_null: int = 199,
    seed: int = 0,
    track: Track | None = None,
) -> list[Cue]:
    """All cues of a distribution.

    Parameters
    ----------
    distribution : Distribution
        On an equal-area grid, once per material, without penalties; materials are summed.
    matrix : (T, N)
        Kernel columns of the distribution.
    facets : Facets
        The few facets of the same light curve.
    n_null : int
        Simulated bodies for each of the two null hypotheses, with 2 n_null solutions in total.

    References
    ----------
    Hall et al. 2007, sec. 3.5. Davison & Hinkley 1997, sec. 4.2 (Monte Carlo tests).
    """
    if track is None:
        with Silent().stage("", 2 * n_null, "") as silent:
            track = silent
    count = int(np.sum(distribution.which == 0))
    maps = Maps(distribution.normals[:count])

    def total(areas: Floats) -> Floats:
        return areas.reshape(-1, count).sum(axis=0)

    smooth = nulls.smooth_bodies(seen, distribution, matrix, n_null, seed, track)
    scattered = nulls.scattered_facets(
        seen, distribution, matrix, facets, materials, n_null, seed + 1, track
    )
    smooth = np.array([total(a) for a in smooth])
    scattered = np.array([total(a) for a in scattered])
    areas = total(distribution.areas)
    arc = _arc(maps, areas, smooth, scattered, facets)
    clusters = _clusters(maps, areas, smooth, arc)
    stand_out = np.array([c["direction"] for c in clusters.details["clusters"]]).reshape(-1, 3)
    near = np.any(facets.normals @ stand_out.T > np.cos(np.radians(CAP)), axis=1)
    if faceted(seen, distribution, matrix, facets):
        near |= facets.areas > WELL_MEASURED * facets.area_sd
    return [
        clusters,
        *angles(facets.normals[near], facets.areas[near] / facets.areas.sum(), seed + 2),
        arc,
        _uniform(maps, areas, scattered),
    ]


def faceted(seen: Observed, distribution: Distribution, matrix: Floats, facets: Facets) -> bool:
    """Whether few flat facets explain the light curve better than a smooth body.

    There must be at most `DISTINCT` facets, and their χ² + 3 n ln T must lie below χ² + 6 ln T of
    the best-fitting ellipsoid (Bayesian information criterion). Some two dozen facets approximate a
    smooth surface, and their mutual angles are those of an even covering of the sphere.
    """
    count = len(facets.areas)
    if count > DISTINCT:
        return False
    model = distribution.scale[seen.curve] * (matrix @ nulls.ellipsoid(seen, distribution, matrix))
    smooth = float(np.sum(((seen.flux - model) / seen.error) ** 2))
    penalty = float(np.log(len(seen.flux)))
    return facets.chi2 + 3 * count * penalty < smooth + 6 * penalty


def _p(statistic: float, null: Sequence[float] | Floats) -> float:
    return float((1 + np.sum(np.asarray(null) >= statistic)) / (1 + len(null)))


def _clusters(maps: Maps, areas: Floats, smooth: Floats, arc: Cue) -> Cue:
    # the observation is part of the pool, as under the null hypothesis
    pool = np.vstack([smooth, areas])
    expected = np.mean([maps.shares(a) for a in pool], axis=0)
    null = [np.max(maps.excess(a, expected)) for a in smooth]
    excess = maps.excess(areas, expected)
    all_ = maps.clusters(areas)
    for c in all_:
        near = np.argsort(-(maps.normals @ c["direction"]))[:4]  # between grid normals
        c["p_value"] = _p(float(excess[near].max()), null)
    significant = [c for c in all_ if c["p_value"] <= SIGNIFICANT]
    flat = significant
    if arc.significant:  # a cluster on an arc belongs to the arc, unless it is distinct
        off = np.sin(np.radians(CAP))
        pole = arc.details["pole"]
        flat = [c for c in significant if abs(c["direction"] @ pole) > off or c["share"] > HEAVY]
    for c in significant:
        c["flat"] = any(c is f for f in flat)
    largest = float(np.max(excess))
    if not significant:
        words = "no direction stands out on the grid from what a smooth body gives"
    elif len(flat) < len(significant):
        others = len(significant) - len(flat)
        words = f"{len(flat)} flat facets at least, besides {others} along the arc"
    else:
        words = f"{len(flat)} flat facet{'s' * (len(flat) != 1)} at least"
    return Cue(
        "clusters",
        largest,
        _p(largest, null),
        "the ellipsoid that fits best",
        words,
        {"clusters": significant, "n_flat": len(flat)},
    )


def _arc(maps: Maps, areas: Floats, smooth: Floats, scattered: Floats, facets: Distribution) -> Cue:
    statistic, pole = maps.arc(areas)
    p = max(_p(statistic, [maps.arc(a)[0] for a in null]) for null in (smooth, scattered))
    near = np.abs(maps.normals @ pole) < np.sin(np.radians(BAND))
    tensor = np.einsum("n,ni,nj->ij", areas * near, maps.normals, maps.normals)
    pole = np.linalg.eigh(tensor)[1][:, 0]  # off the grid: plane of the arc
    along = int(np.sum(np.abs(facets.normals @ pole) < np.sin(np.radians(BAND))))
    words = "no great circle along which the area lies evenly"
    if p <= SIGNIFICANT:
        words = (
            f"{100 * statistic:.0f} % of the area outside large flat facets lies evenly along a "
            f"great circle, in {along} facets: a cylinder, a cone or a prism"
        )
    return Cue(
        "arc",
        statistic,
        p,
        "the larger p of two: the ellipsoid that fits best; the same facets facing at random",
        words,
        {"pole": pole, "n_facets": along},
    )


def _uniform(maps: Maps, areas: Floats, scattered: Floats) -> Cue:
    statistic = maps.uniform(areas)
    p = _p(statistic, [maps.uniform(a) for a in scattered])
    words = "no large region of even density"
    if p <= SIGNIFICANT:
        words = (
            f"the density is even over {100 * statistic:.0f} % of the directions, as on a sphere"
        )
    return Cue("uniform", statistic, p, "the same facets facing at random", words)


def angles(normals: Floats, share: Floats, seed: int) -> list[Cue]:
    """Test for an excess of facet pairs at 90, 60 or 45 degrees over random orientations.

    Facets opposite each other within 5 degrees count once, as an axis; angles are folded to 0..90.
    The statistic is the mean of exp(−(θ_ij − ψ)²/2(3°)²) over all pairs of axes with at least 3 %
    of the area. The null hypothesis is the same number of axes with random orientations.

    Parameters
    ----------
    normals : (n, 3)
        Normals of facets that are distinct or well measured; without any, no test is made.
    share : (n,)
        Shares of the body's total area.
    """
    large = np.argsort(-share)
    large = large[share[large] >= SMALL]
    axes: list[Floats] = []
    for i in large:
        vector = share[i] * normals[i]
        for k, axis in enumerate(axes):
            cosine = normals[i] @ axis / np.linalg.norm(axis)
            if abs(cosine) > np.cos(np.radians(ALONG)):
                axes[k] = axis + np.sign(cosine) * vector
                break
        else:
            axes.append(vector)
    vectors = np.array(axes)
    n = len(vectors)
    null = "as many axes that point at random"
    if n < 2:
        words = "fewer than two axes of distinct facets"
        return [Cue(f"angle-{a:.0f}", 0.0, 1.0, null, words) for a in ANGLES]
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    random = np.random.default_rng(seed).normal(size=(ANGLE_DRAWS, n, 3))
    random /= np.linalg.norm(random, axis=2, keepdims=True)
    i, j = np.triu_indices(n, 1)

    def between(axes: Floats) -> Floats:
        cosine = np.abs(np.sum(axes[..., i, :] * axes[..., j, :], axis=-1))
        return np.degrees(np.arccos(np.minimum(cosine, 1.0)))

    seen_angles, null_angles = between(vectors), between(random)
    cues = []
    for angle in ANGLES:
        statistic, drawn = (
            np.mean(np.exp(-0.5 * ((a - angle) / ANGLE_SD) ** 2), axis=-1)
            for a in (seen_angles, null_angles)
        )
        p = _p(float(statistic), drawn)
        met = int(np.sum(np.abs(seen_angles - angle) < 2 * ANGLE_SD))
        words = f"{met} of {len(i)} angles between {n} axes of facets are {angle:.0f} degrees"
        words += f", as in {BODIES[angle]}" if p <= SIGNIFICANT else ", no more than by chance"
        cues.append(Cue(f"angle-{angle:.0f}", float(statistic), p, null, words, {"n_axes": n}))
    return cues
