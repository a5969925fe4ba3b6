"""Statistics of a distribution on an equal-area grid: caps, great circles, uniform regions."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

TINY = 1e-300  # replaces an area of zero
CAP = 15.0  # degrees; radius of a cluster
APART = 25.0  # degrees; least separation of clusters
HEAVY = 0.15  # share of the area above which a cap is excluded from the search for arcs
BAND = 12.0  # degrees; half-width of the band about a great circle
BINS = 24  # along the band
PATCH = 30.0  # degrees; densities are means over caps of this radius
EVEN = 0.25  # relative deviation from the mean density below which a patch is uniform
LARGE = 0.4  # least fraction of all directions in a uniform region, as any body has some


class Maps:
    """Statistics of areas on a grid of normals; they do not depend on the size of the body.

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
        """Heaviest caps in sequence: mean direction and share of the total area."""
        left, total, clusters = areas.copy(), areas.sum(), []
        while len(clusters) < most and total > 0:
            heaviest = int(np.argmax(self.cap @ left))
            inside = self.cap[heaviest] * left
            share = float(inside.sum() / total)
            if share <= max(least, 0.0):
                break
            mean = inside @ self.normals
            mean /= np.linalg.norm(mean)
            clusters.append({"direction": mean, "share": share})
            left = np.where(self.normals @ mean > np.cos(np.radians(APART)), 0.0, left)
        return clusters

    def shares(self, areas: Floats) -> Floats:
        """Share of the total area in the cap about each normal, (N,)."""
        return self.cap @ areas / max(float(areas.sum()), TINY)

    def excess(self, areas: Floats, expected: Floats) -> Floats:
        """(share − expected)/√(expected + its mean) of every cap, (N,).

        Spikes have the same typical area everywhere. Their number, and hence the variance of a
        cap's share, is therefore proportional to the expected share.
        """
        share = self.shares(areas)
        return (share - expected) / np.sqrt(expected + expected.mean())

    def arc(self, areas: Floats) -> tuple[float, Floats]:
        """Share of area spread evenly along a great circle, and the pole of the circle.

        Caps with more than `HEAVY` of the area are excluded first, so that the ends of a cylinder
        do not mask its side. The statistic for the rest is Σ_bins min(share, 1/24) over 24 bins
        along the band about a circle, maximised over all circles. It is 1 for the side of a
        cylinder, 4/24 to 8/24 for four faces and about 1/4 for a sphere.
        """
        rest = areas
        for cluster in self.clusters(areas, HEAVY):
            rest = np.where(
                self.normals @ cluster["direction"] > np.cos(np.radians(CAP)), 0.0, rest
            )
        if rest.sum() <= 1e-3 * areas.sum():
            return 0.0, self.poles[0]
        share = (self.bands @ rest).reshape(-1, BINS) / rest.sum()
        even = np.minimum(share, 1.0 / BINS).sum(axis=1)
        return float(even.max()), self.poles[np.argmax(even)]

    def uniform(self, areas: Floats) -> float:
        """Fraction of directions about which the density equals the overall mean within 25 %.

        It is 1 for a sphere. Values below 40 % are set to 0, because the density of any body passes
        through its mean somewhere.
        """
        density = self.patch @ areas
        part = float(np.mean(np.abs(density / max(float(density.mean()), TINY) - 1.0) < EVEN))
        return part if part >= LARGE else 0.0
