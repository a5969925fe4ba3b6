"""What a distribution says of the body's shape, with a statistic and a p-value for each cue."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcbayes.albedo_area import nulls
from lcbayes.albedo_area.distribution import Distribution
from lcbayes.albedo_area.kernel import Material
from lcbayes.albedo_area.observed import Observed
from lcbayes.progress import Silent, Track

Floats = NDArray[np.float64]

SIGNIFICANT = 0.05
CAP = 15.0  # degrees; what lies within this of a direction is one cluster
APART = 25.0  # degrees between clusters
HEAVY = 0.15  # share of the area in a cap from which it is left out of the search for arcs
BAND = 12.0  # degrees either side of a great circle
BINS = 24  # along it
PATCH = 30.0  # degrees; densities are means over caps of this radius
EVEN = 0.25  # of the mean density: patches nearer to it are even
LARGE = 0.4  # of all directions: less is not called an even region, as any body has some
ANGLES = (90.0, 60.0, 45.0)
BODIES = {90.0: "a box or a prism", 60.0: "a hexagonal prism", 45.0: "an octagonal prism"}
ANGLE_SD = 3.0  # degrees, in which an angle counts as met
ALONG = 5.0  # degrees within which facets are taken to lie opposite each other
SMALL = 0.03  # share of the area from which a facet counts for angles
ANGLE_DRAWS = 1999


@dataclass(frozen=True)
class Cue:
    """One property of a body, tested.

    Attributes
    ----------
    name : "clusters", "arc", "uniform", "angle-90", "angle-60" or "angle-45"
    statistic : float
    p_value : float
        Chance of so large a statistic under ``null``, from n simulations: (1 + as large)/(1 + n).
    null : str
        In words.
    words : str
        What was found, for a reader.
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


class Maps:
    """Statistics of areas on a grid of normals; those of a body do not depend on its size.

    Parameters
    ----------
    normals : (N, 3)
        Equal-area grid.
    """

    def __init__(self, normals: Floats) -> None:
        self.normals = normals
        cosine = normals @ normals.T
        self.cap = (cosine > np.cos(np.radians(CAP))).astype(float)
        self.patch = (cosine > np.cos(np.radians(PATCH))).astype(float)
        self.patch /= self.patch.sum(axis=1, keepdims=True)
        self.poles = normals[normals[:, 2] >= 0.0]
        self.bands = np.zeros((len(self.poles) * BINS, len(normals)))
        for i, pole in enumerate(self.poles):
            u = np.cross(pole, np.eye(3)[np.argmin(np.abs(pole))])
            v = np.cross(pole, u)
            near = np.flatnonzero(np.abs(normals @ pole) < np.sin(np.radians(BAND)))
            turn = np.arctan2(normals[near] @ v / np.linalg.norm(v), normals[near] @ u)
            self.bands[i * BINS + np.floor(turn / (2 * np.pi) * BINS).astype(int) % BINS, near] = 1

    def clusters(self, areas: Floats, least: float = 0.0, most: int = 20) -> list[dict[str, Any]]:
        """Heaviest caps, one after the other: mean direction and share of all area."""
        left, total, found = areas.copy(), areas.sum(), []
        while len(found) < most and total > 0:
            heaviest = int(np.argmax(self.cap @ left))
            inside = self.cap[heaviest] * left
            share = float(inside.sum() / total)
            if share <= max(least, 0.0):
                break
            mean = inside @ self.normals
            mean /= np.linalg.norm(mean)
            found.append({"direction": mean, "share": share})
            left = np.where(self.normals @ mean > np.cos(np.radians(APART)), 0.0, left)
        return found

    def excess(self, areas: Floats, expected: Floats) -> Floats:
        """(share − expected)/√(expected + its mean) of every cap, (N,).

        Spikes are as heavy wherever they are, so that their number, and with it the variance of a
        cap's share, goes with what is expected there.
        """
        share = self.cap @ areas / areas.sum()
        return (share - expected) / np.sqrt(expected + expected.mean())

    def arc(self, areas: Floats) -> tuple[float, Floats]:
        """How much lies evenly along a great circle, and the circle's pole.

        Caps that hold more than `HEAVY` of the area are left out first: the ends of a cylinder
        must not hide its side. Of the rest, Σ_bins min(share, 1/24) over 24 bins along the band
        about a circle, the largest over all circles: 1 for the side of a cylinder, 4/24 to 8/24
        for four faces, about 1/4 for a sphere.
        """
        rest = areas
        for cluster in self.clusters(areas, HEAVY):
            rest = np.where(
                self.normals @ cluster["direction"] > np.cos(np.radians(CAP)), 0.0, rest
            )
        if rest.sum() < 1e-3 * areas.sum():
            return 0.0, self.poles[0]
        share = (self.bands @ rest).reshape(-1, BINS) / rest.sum()
        even = np.minimum(share, 1.0 / BINS).sum(axis=1)
        return float(even.max()), self.poles[np.argmax(even)]

    def uniform(self, areas: Floats) -> float:
        """Part of all directions about which the density is the mean of all, to 25 %.

        1 for a sphere. Less than 40 % counts as 0: there is always some place between few and many.
        """
        density = self.patch @ areas
        part = float(np.mean(np.abs(density / density.mean() - 1.0) < EVEN))
        return part if part >= LARGE else 0.0


def find(
    seen: Observed,
    found: Distribution,
    matrix: Floats,
    few: Distribution,
    materials: Sequence[Material],
    n_null: int = 199,
    seed: int = 0,
    track: Track | None = None,
) -> list[Cue]:
    """All cues of a distribution.

    Parameters
    ----------
    found : Distribution
        On an equal-area grid, once per material, without penalties; materials are added up.
    matrix : (T, N)
        Its columns.
    few : Distribution
        The few facets of the same light curve.
    n_null : int
        Simulated bodies for each of the two nulls; 2 n_null solutions in all.

    References
    ----------
    Hall et al. 2007, sec. 3.5. Davison & Hinkley 1997, sec. 4.2 (Monte Carlo tests).
    """
    if track is None:
        with Silent().stage("", 2 * n_null, "") as silent:
            track = silent
    count = int(np.sum(found.which == 0))
    maps = Maps(found.normals[:count])

    def total(areas: Floats) -> Floats:
        return areas.reshape(-1, count).sum(axis=0)

    smooth = nulls.smooth_bodies(seen, found, matrix, n_null, seed, track)
    scattered = nulls.scattered_facets(seen, found, matrix, few, materials, n_null, seed + 1, track)
    smooth = np.array([total(a) for a in smooth])
    scattered = np.array([total(a) for a in scattered])
    areas = total(found.areas)
    arc = _arc(maps, areas, smooth, scattered, few)
    clusters = _clusters(maps, areas, smooth, arc)
    stand_out = np.array([c["direction"] for c in clusters.details["clusters"]]).reshape(-1, 3)
    near = np.any(few.normals @ stand_out.T > np.cos(np.radians(CAP)), axis=1)
    return [
        clusters,
        *angles(few.normals[near], few.areas[near] / few.areas.sum(), seed + 2),
        arc,
        _uniform(maps, areas, scattered),
    ]


def _p(statistic: float, null: Sequence[float] | Floats) -> float:
    return float((1 + np.sum(np.asarray(null) >= statistic)) / (1 + len(null)))


def _clusters(maps: Maps, areas: Floats, smooth: Floats, arc: Cue) -> Cue:
    # the observed is one of the pool, as it would be if the null were true
    pool = np.vstack([smooth, areas])
    expected = np.mean([maps.cap @ a / a.sum() for a in pool], axis=0)
    null = [np.max(maps.excess(a, expected)) for a in smooth]
    excess = maps.excess(areas, expected)
    all_ = maps.clusters(areas)
    for c in all_:
        near = np.argsort(-(maps.normals @ c["direction"]))[:4]  # it lies between grid normals
        c["p_value"] = _p(float(excess[near].max()), null)
    found = [c for c in all_ if c["p_value"] <= SIGNIFICANT]
    flat = found
    if arc.significant:  # what lies along an arc is part of it, unless it stands out
        off = np.sin(np.radians(CAP))
        pole = arc.details["pole"]
        flat = [c for c in found if abs(c["direction"] @ pole) > off or c["share"] > HEAVY]
    for c in found:
        c["flat"] = any(c is f for f in flat)
    largest = float(np.max(excess))
    if not found:
        words = "no direction stands out from what a smooth body gives"
    elif len(flat) < len(found):
        words = f"{len(flat)} flat facets at least, besides {len(found) - len(flat)} along the arc"
    else:
        words = f"{len(flat)} flat facet{'s' * (len(flat) != 1)} at least"
    return Cue(
        "clusters", largest, _p(largest, null), "the ellipsoid that fits best", words,
        {"clusters": found, "n_flat": len(flat)},
    )  # fmt: skip


def _arc(maps: Maps, areas: Floats, smooth: Floats, scattered: Floats, few: Distribution) -> Cue:
    statistic, pole = maps.arc(areas)
    p = max(_p(statistic, [maps.arc(a)[0] for a in null]) for null in (smooth, scattered))
    near = np.abs(maps.normals @ pole) < np.sin(np.radians(BAND))
    tensor = np.einsum("n,ni,nj->ij", areas * near, maps.normals, maps.normals)
    pole = np.linalg.eigh(tensor)[1][:, 0]  # off the grid, the plane through what lies along it
    along = int(np.sum(np.abs(few.normals @ pole) < np.sin(np.radians(BAND))))
    words = "no great circle along which the area lies evenly"
    if p <= SIGNIFICANT:
        words = (
            f"{100 * statistic:.0f} % of the area outside large flat facets lies evenly along a "
            f"great circle, in {along} facets: a cylinder, a cone or a prism"
        )
    return Cue(
        "arc", statistic, p,
        "the larger p of two: the ellipsoid that fits best; the same facets facing at random",
        words, {"pole": pole, "n_facets": along},
    )  # fmt: skip


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
    """Whether facets stand at 90, 60 or 45 degrees to each other more than chance has it.

    Facets that lie opposite each other, to 5 degrees, count once, as an axis; angles are folded to
    0..90. The statistic is the mean of exp(−(θ_ij − ψ)²/2(3°)²) over all pairs of axes with at
    least 3 % of the area. Null: as many axes that point at random.

    Parameters
    ----------
    normals : (n, 3)
        Of facets that stand out; without any nothing is tested.
    share : (n,)
        Of the body's whole area.
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
        words = "fewer than two axes of facets that stand out"
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
