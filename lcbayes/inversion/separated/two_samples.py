"""Distances between samples in the plane and a distribution represented by many draws.

There are two distances: the Kolmogorov-Smirnov distance over the four quadrants of every point, and
the energy distance. Terms that depend only on the draws are tabulated once. All samples, hundreds
for a null distribution, are processed in one compiled loop.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.jax_setup import jax, jnp

Floats = NDArray[np.float64]

NODES, BINS, SOME, ORIGINS = 40, 192, 2000, 200
PAD = 64  # samples are padded to multiples of this, to limit the number of compiled sizes


class Reference:
    """A distribution in the plane, from draws (M, 2) in units that give both axes equal weight.

    Samples may lie within the rectangle ``low`` .. ``high``; points outside are moved to its edge.
    """

    def __init__(self, draws: Floats, low: Floats, high: Floats) -> None:
        self.low, self.high = np.asarray(low, float), np.asarray(high, float)
        draws = np.clip(draws, self.low, self.high)
        axes = [np.linspace(a, b, NODES) for a, b in zip(self.low, self.high, strict=True)]
        nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
        some = draws[np.arange(SOME) * len(draws) // SOME]  # of fixed size, compiled once
        self._potential = np.asarray(_mean_distance(jnp.asarray(nodes), jnp.asarray(some)))
        self._potential = self._potential.reshape(NODES, NODES)
        place = (some - self.low) / (self.high - self.low)
        self._own = float(np.mean(_at(self._potential, jnp.asarray(place))))
        count, *_ = np.histogram2d(*draws.T, bins=BINS, range=list(zip(low, high, strict=True)))
        self._below = np.zeros((BINS + 1, BINS + 1))
        self._below[1:, 1:] = np.cumsum(np.cumsum(count, axis=0), axis=1) / len(draws)
        self._origins = draws[np.arange(ORIGINS) * len(draws) // ORIGINS]

    def distances(self, samples: list[Floats]) -> tuple[Floats, Floats]:
        """Distances of each kind, (B,), for B samples (n, 2).

        The Kolmogorov-Smirnov distance is the largest difference of the shares in a quadrant. It is
        the mean of the values for quadrants about points of the sample and about points of the
        distribution. The energy distance is 2 E|X − Y| − E|X − X′| − E|Y − Y′|, X ≠ X′.

        References
        ----------
        Press et al. 1992, Numerical Recipes, sec. 14.7; Fasano & Franceschini 1987, MNRAS 225, 155;
        Székely & Rizzo 2013, J. Stat. Plann. Inference 143, 1249.
        """
        size = -(-max(map(len, samples)) // PAD) * PAD
        points = np.tile(0.5 * (self.low + self.high), (len(samples), size, 1))
        weight = np.zeros((len(samples), size))
        for i, sample in enumerate(samples):
            points[i, : len(sample)] = np.clip(sample, self.low, self.high)
            weight[i, : len(sample)] = 1.0 / len(sample)
        distances = _distances(
            *map(
                jnp.asarray,
                (points, weight, self._potential, self._below, self._origins, self.low, self.high),
            ),
            self._own,
        )
        return np.asarray(distances[0]), np.asarray(distances[1])


@jax.jit
def _distances(points, weight, potential, below, origins, low, high, own):
    def shares(about):
        """Shares of the distribution in the quadrants about each point, (n, 4)."""
        x, y = ((about - low) / (high - low)).T
        one = jnp.ones_like(x)
        both, left, under = (_at(below, jnp.stack(p, axis=1)) for p in ((x, y), (x, one), (one, y)))
        return _four(both, left, under)

    def counted(sample, w, about):
        """Shares of a sample; ties, as on the edge, count as one half."""
        left, under = (
            0.5 * (1.0 + jnp.sign(about[:, k, None] - sample[None, :, k])) for k in (0, 1)
        )
        return _four((left * under) @ w, left @ w, under @ w)

    at_origins = shares(origins)

    def one(args):
        sample, w = args
        used = (w > 0)[:, None]
        near = jnp.max(jnp.abs(counted(sample, w, sample) - shares(sample)) * used)
        far = jnp.max(jnp.abs(counted(sample, w, origins) - at_origins))
        apart = sum((sample[:, k, None] - sample[None, :, k]) ** 2 for k in (0, 1))
        within = w @ jnp.sqrt(apart) @ w
        n = 1.0 / jnp.max(w)
        outer = w @ _at(potential, (sample - low) / (high - low))
        return 0.5 * (near + far), 2.0 * outer - within * n / (n - 1.0) - own

    return jax.lax.map(one, (points, weight))


def _four(both, left, under):
    """Shares of the four quadrants from the lower left quadrant and two half planes."""
    return jnp.stack([both, left - both, under - both, 1.0 - left - under + both], axis=1)


def _at(table, part):
    """Bilinear interpolation in a table over the unit square, (n,)."""
    table = jnp.asarray(table)
    size = jnp.array(table.shape) - 1
    place = part * size
    cell = jnp.clip(place.astype(int), 0, size - 1)
    (i, j), (x, y) = cell.T, (place - cell).T
    return (
        table[i, j] * (1 - x) * (1 - y)
        + table[i + 1, j] * x * (1 - y)
        + table[i, j + 1] * (1 - x) * y
        + table[i + 1, j + 1] * x * y
    )


@jax.jit
def _mean_distance(points, others):
    """Mean distance of each point from all others, (n,)."""

    def one(point):
        return jnp.mean(jnp.sqrt(jnp.sum((others - point) ** 2, axis=1)))

    return jax.lax.map(one, points, batch_size=64)
