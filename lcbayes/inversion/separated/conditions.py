"""Conditions of a shape match: independent points and unrepeated orientations."""

from __future__ import annotations

import numpy as np

from lcbayes.core.errors import InputError
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.separated.attitude_test import alike
from lcbayes.inversion.separated.reduced import Floats, Reduced, in_body, turns
from lcbayes.modelling.ephemeris import ephemeris
from lcbayes.physics.attitude import catalogue

REACH_MAG = 4.0  # from the median; magnitudes beyond are clipped
STABLE_P, STABLE_PAIRS, STABLE_REACH_DEG = 0.01, 30, 8.0
STABLE_RATIO = 0.6  # largest ratio of differences under a law to random ones, for a stabilised body
STABLE_LAWS = ("inertial", "lvlh", "yaw-steering", "sun-north", "sun-pointing", "earth-north")


def phase_angles(seen: Reduced) -> Floats:
    """Phase angle of every point, (T,) rad."""
    cross = np.linalg.norm(np.cross(seen.sun, seen.obs), axis=1)
    return np.arctan2(cross, np.sum(seen.sun * seen.obs, axis=1))


def correlated(seen: Reduced) -> float:
    """Number of successive points per independent point, 1 + 2 Σ ρ_k.

    ρ is the correlation of magnitudes within passes, after removal of their trend with phase angle.
    The sum ends where ρ falls below its noise (Sokal's window of positive terms).
    """
    left = _without_trend(phase_angles(seen), -2.5 * np.log10(np.maximum(seen.flux, 1e-300)))
    left = np.clip(left, -REACH_MAG, REACH_MAG)
    total = 1.0
    for k in range(1, len(left) // 4):
        same = seen.one_pass[k:] == seen.one_pass[:-k]
        if np.sum(same) < 20:
            break
        rho = np.mean((left[k:] * left[:-k])[same]) / np.mean(left**2)
        if rho < 2.0 / np.sqrt(np.sum(same)):
            break
        total += 2.0 * rho
    return float(total)


def _without_trend(phase: Floats, magnitude: Floats) -> Floats:
    base = np.polynomial.legendre.legvander(2.0 * phase / np.pi - 1.0, 2)
    fitted, *_ = np.linalg.lstsq(base, magnitude, rcond=None)
    return magnitude - base @ fitted


def stabilised(
    curve: LightCurve, seen: Reduced, phase: Floats, magnitude: Floats, rng: np.random.Generator
) -> tuple[float, str, float]:
    """p-value for brightness that does not repeat under any common law, the nearest law, and ratio.

    The statistic is the mean absolute magnitude difference of pairs with matching geometry under a
    law, after removal of the trend with phase angle. Its minimum over the laws is ranked among the
    minima for permutations of the points. The ratio is that difference over the mean of the
    permutations. The brightness of a body that spins about a fixed axis depends weakly on its
    geometry, whereas that of a stabilised body repeats. The ratio is 1 if no law has enough pairs.
    """
    left = np.clip(_without_trend(phase, magnitude), -REACH_MAG, REACH_MAG)
    eph = ephemeris(curve)
    tried = np.array([left, *(rng.permutation(left) for _ in range(199))])
    scores, names, ratios = [], [], []
    for name in STABLE_LAWS:
        law = catalogue.find(name)
        try:
            parts = in_body(turns(law, eph, seen)[:1], seen)
        except InputError:
            continue
        pairs = alike(parts, seen, np.radians(STABLE_REACH_DEG))
        if len(pairs.i) < STABLE_PAIRS:
            continue
        mean = np.mean(np.abs(tried[:, pairs.i] - tried[:, pairs.j]), axis=1)
        scores.append((mean - mean[1:].mean()) / mean[1:].std())
        names.append(name)
        ratios.append(float(mean[0] / mean[1:].mean()))
    if not names:
        return 1.0, "", 1.0
    least = np.min(scores, axis=0)
    p = (1 + np.sum(least[1:] <= least[0])) / len(least)
    nearest = int(np.argmin([s[0] for s in scores]))
    return float(p), names[nearest], ratios[nearest]
