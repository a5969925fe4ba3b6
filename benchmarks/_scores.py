"""Whether printed intervals contain the truth, and rates with their Monte Carlo errors.

No code of the package: the functions take draws and the truth as arrays.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

Floats = NDArray[np.float64]

LEVEL = 0.9


class Draws(NamedTuple):
    """Draws of one solution: angular velocity (S, 3), normals (S, N, 3), albedo-areas (S, N)."""

    omega: Floats
    normals: Floats
    areas: Floats


class Truth(NamedTuple):
    """The same quantities of the simulated body, (3,), (N, 3), (N,)."""

    omega: Floats
    normals: Floats
    areas: Floats


def within(draws: Floats, truth: float) -> bool:
    """Whether the central 90 % interval of the draws (S,) contains the truth."""
    low, high = np.quantile(draws, [0.5 - LEVEL / 2, 0.5 + LEVEL / 2])
    return bool(low <= truth <= high)


def angle_within(draws: Floats, truth: float) -> bool:
    """`within` for angles in rad, which are unwrapped about the mean direction of the draws."""
    middle = np.angle(np.mean(np.exp(1j * draws)))
    unwrapped = np.angle(np.exp(1j * (draws - middle)))
    return within(unwrapped, float(np.angle(np.exp(1j * (truth - middle)))))


def direction_within(draws: Floats, truth: Floats) -> dict[str, bool]:
    """Longitude and latitude of a direction, draws (S, 3) of any length and truth (3,)."""
    unit = draws / np.linalg.norm(draws, axis=1, keepdims=True)
    truth = truth / np.linalg.norm(truth)
    return {
        "lon": angle_within(np.arctan2(unit[:, 1], unit[:, 0]), np.arctan2(truth[1], truth[0])),
        "lat": within(unit[:, 2], truth[2]),
    }


def matched(result: Draws, truth: Truth) -> tuple[NDArray[np.int64], float]:
    """For each true facet the one of the solution that is closest, and the total distance.

    The distance of two facets is that of their mean normals times areas, relative to the largest
    true area; the distance of the angular velocities, relative to the true one, is added.
    """
    mean = (result.normals * result.areas[..., None]).mean(axis=0)
    true = truth.normals * truth.areas[:, None]
    cost = np.linalg.norm(mean[None] - true[:, None], axis=-1) / truth.areas.max()
    rows, columns = linear_sum_assignment(cost)
    off = np.linalg.norm(result.omega.mean(axis=0) - truth.omega) / np.linalg.norm(truth.omega)
    return columns[np.argsort(rows)], float(cost[rows, columns].sum() + off)


def body_inside(solutions: list[Draws], truth: Truth) -> dict[str, bool]:
    """Each printed quantity of the solution nearest to the truth: is the truth in its interval?

    Facets are exchangeable, so they are matched first. A fit that states several solutions makes a
    statement about each; the nearest one is scored. (The only other symmetry of such bodies, the
    reflection in a plane that contains Sun and observer at all times, needs such a plane.)
    """
    result, order = min(((s, matched(s, truth)) for s in solutions), key=lambda pair: pair[1][1])
    columns = order[0]
    rate = np.linalg.norm(result.omega, axis=1)
    inside = {"rate": within(rate, float(np.linalg.norm(truth.omega)))}
    inside |= {f"pole {k}": v for k, v in direction_within(result.omega, truth.omega).items()}
    for i, j in enumerate(columns):
        inside[f"area {i}"] = within(result.areas[:, j], truth.areas[i])
        each = direction_within(result.normals[:, j], truth.normals[i])
        inside |= {f"normal {i} {k}": v for k, v in each.items()}
    return inside


class Rate(NamedTuple):
    """A share with its Monte Carlo standard error; NaN if there is nothing to count."""

    value: float
    se: float

    def __str__(self) -> str:
        return "–" if np.isnan(self.value) else f"{100 * self.value:.0f} ± {100 * self.se:.0f} %"


def share(hits: int, n: int) -> Rate:
    """Share of independent trials; the error is that of (k + 1)/(n + 2), so that it is not 0."""
    if n == 0:
        return Rate(np.nan, np.nan)
    p = (hits + 1.0) / (n + 2.0)
    return Rate(hits / n, float(np.sqrt(p * (1.0 - p) / n)))


def pooled(hits: Floats, counts: Floats) -> Rate:
    """Share of quantities inside over fits, whose quantities are correlated within a fit.

    The error is that of a ratio estimate over the fits (Cochran 1977, Sampling Techniques, eq.
    6.13), and at least the binomial one.

    Parameters
    ----------
    hits, counts : (F,) quantities inside, and all quantities, of each fit
    """
    hits, counts = np.asarray(hits, float), np.asarray(counts, float)
    n = counts.sum()
    if n == 0:
        return Rate(np.nan, np.nan)
    value = hits.sum() / n
    fits = len(hits)
    scatter = np.sum((hits - value * counts) ** 2) * fits / max(fits - 1, 1)
    return Rate(float(value), float(max(np.sqrt(scatter) / n, share(int(hits.sum()), int(n)).se)))


def encoded(inside: Mapping[str, bool]) -> str:
    """The quantities that are outside, for a table of cases."""
    return ";".join(name for name, held in inside.items() if not held)
