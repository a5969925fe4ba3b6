"""Pole and sidereal frequency from phases of the modulation: the posterior over the sky.

The modulation of a body that spins about a pole p at a rate Ω > 0 follows the angle Ω t − λ(t; p).
Here λ is the right-handed azimuth about p of the symmetry direction of the brightness. A base of m
cycles per turn therefore has the phase

    Ψ(t) = m [Ω t − λ(t; p)] + constant,

and its frequency, the synodic one, differs from the sidereal one by m λ̇/2π (Hall et al. 2007,
sec. 4.1; Magnusson 1986). Azimuths about −p increase in the opposite direction: the pole includes
the sense of rotation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from lcbayes.inversion.spin.windows import Phases

Floats = NDArray[np.float64]

MULTIPLES = (1, 2, 4)  # cycles of the base per turn
SYMMETRIES = ("bisector", "mean azimuth", "rod")
SHAPE_DEG = (3.0, 10.0, 30.0)  # rms shift of the rotational phase by the shape
REACH = 1.5  # rad; correlation length of that shift along the bisector
LARGEST = 6.0  # upper limit on the growth of the shift with phase angle
SHARED = 0.8  # fraction of its variance common to all harmonics
COARSE, FINE = 3000, 48000
POWER = 1.0  # power of the likelihood, times the number of passes
DEEP = 40.0  # nats below the best; range evaluated in more detail


@dataclass(frozen=True)
class Sky:
    """Posterior of pole and sidereal frequency under flat priors.

    Attributes
    ----------
    poles : (G, 3)
        Unit vectors of equal-area cells of the sky.
    cell : sr
        Area of a cell.
    weight : (G, M)
        Posterior probability by pole and multiple m; the sum is one.
    frequency, error : (G, M) Hz
        Sidereal frequency and its standard deviation, given pole and multiple.
    symmetry : dict
        Probability of each symmetry direction of the brightness.
    shape_deg : deg
        Posterior mean of the phase shift by the shape.
    chi2, freedom :
        Least χ² over the sky with that shift as an additional error, and its degrees of freedom.
    """

    poles: Floats
    cell: float
    weight: Floats
    frequency: Floats
    error: Floats
    symmetry: dict[str, float]
    shape_deg: float
    chi2: float
    freedom: int

    def region(self, probability: float = 0.9) -> NDArray[np.bool_]:
        """The smallest set of poles with that probability, (G,)."""
        total = self.weight.sum(axis=1)
        order = np.argsort(-total)
        count = int(np.searchsorted(np.cumsum(total[order]), probability)) + 1
        chosen = np.zeros(len(total), bool)
        chosen[order[:count]] = True
        return chosen

    @property
    def area(self) -> float:
        """Fraction of the sky in the 90 % region."""
        return float(self.region().sum() * self.cell / (4 * np.pi))


def azimuths(poles: Floats, vectors: Floats) -> Floats:
    """Azimuth (rad) of vectors (W, 3) about each pole (G, 3), right-handed, unwrapped along W."""
    e1, e2 = axes(poles)
    return np.unwrap(np.arctan2(vectors @ e2.T, vectors @ e1.T), axis=0).T


def axes(poles: Floats) -> tuple[Floats, Floats]:
    """Unit vectors that form a right-handed triad with each pole, (G, 3) each."""
    other = np.eye(3)[np.argmin(np.abs(poles), axis=1)]
    e1 = np.cross(other, poles)
    e1 /= np.linalg.norm(e1, axis=1, keepdims=True)
    return e1, np.cross(poles, e1)


def symmetric_azimuth(poles: Floats, sun: Floats, obs: Floats, symmetry: str) -> Floats:
    """Azimuth of the symmetry direction of the brightness, (G, W), unwrapped along W.

    "bisector" is the phase-angle bisector. It is exact for mirrors: a facet glints when its normal
    points along the bisector. "mean azimuth" halves the angle between the azimuths of Sun and
    observer. It is exact for diffuse facets parallel to the spin axis:
    max(0, cos(φ − φ_s)) max(0, cos(φ − φ_o)) is even about it.
    """
    if symmetry == "bisector":
        return azimuths(poles, sun + obs)
    e1, e2 = axes(poles)
    total = 0.0
    for vectors in (sun, obs):
        plane = (vectors @ e1.T) + 1j * (vectors @ e2.T)
        total = total + plane / np.maximum(np.abs(plane), 1e-12)
    return np.unwrap(np.angle(total), axis=0).T


def rod_azimuth(poles: Floats, sun: Floats, obs: Floats, harmonic: int) -> Floats:
    """The same for the 2nd or 4th harmonic of a diffuse cylinder tumbling end over end, (G, W).

    The cylinder axis is at azimuth φ in the plane of rotation. The projections of the directions on
    the plane normal to the axis have lengths sin θ_s and sin θ_o and enclose an angle ψ. Then

        F(φ) ∝ sin θ_s sin θ_o [sin ψ + (π − ψ) cos ψ],

    integrated over the lateral surface. The azimuth is that of the Fourier coefficient.
    """
    e1, e2 = axes(poles)
    n = 12
    phi = np.pi * np.arange(n) / n  # the second half of the turn is identical
    (s1, s2), (o1, o2) = ((v @ e1.T, v @ e2.T) for v in (sun, obs))  # (W, G)
    together = np.sum(sun * obs, axis=1)[:, None]
    total = np.zeros(s1.shape, complex)
    for angle in phi:
        c, s = np.cos(angle), np.sin(angle)
        sx, ox = c * s1 + s * s2, c * o1 + s * o2
        across = np.sqrt(np.maximum((1 - sx**2) * (1 - ox**2), 1e-24))
        cos = np.clip((together - sx * ox) / across, -1.0, 1.0)
        psi = np.arccos(cos)
        flux = across * (np.sqrt(1 - cos**2) + (np.pi - psi) * cos)
        total += flux * np.exp(1j * harmonic * angle)
    # brightest with the axis normal to the directions: a constant offset of a quarter turn
    return np.unwrap(np.angle(total), axis=0).T / harmonic


def _symmetric(
    poles: Floats, seen: Phases, symmetry: str, multiple: int, known: dict[tuple, Floats]
) -> Floats:
    """Mean of that azimuth over each window, (G, W); ``known`` caches earlier results."""
    out = np.empty((len(poles), len(seen.t)))
    for line in range(seen.line.max() + 1):
        here = seen.line == line
        harmonic = 0
        if symmetry == "rod":
            harmonic = 4 if seen.harmonic[here][0] * multiple >= 4 else 2
        key = (symmetry, int(seen.which[here][0]), harmonic)
        if key not in known:  # all lines of a pass have the same windows
            sun, obs = seen.sun[here].reshape(-1, 3), seen.obs[here].reshape(-1, 3)
            flat = (
                rod_azimuth(poles, sun, obs, harmonic)
                if harmonic
                else symmetric_azimuth(poles, sun, obs, symmetry)
            )
            known[key] = flat.reshape(len(poles), int(here.sum()), -1).mean(axis=2)
        out[:, here] = known[key]
    return out


def shape_covariance(seen: Phases) -> Floats:
    """Covariance of the relative phase shifts caused by the shape, (W, W).

    A shift depends smoothly on the directions of illumination and observation. Within a pass, the
    correlation is a Gaussian function of the change in bisector and half phase angle. Different
    passes are independent.
    """
    sun, obs = seen.sun.mean(axis=1), seen.obs.mean(axis=1)
    middle = sun + obs
    middle /= np.linalg.norm(middle, axis=1, keepdims=True)
    half = 0.5 * np.arccos(np.clip(np.sum(sun * obs, axis=1), -1.0, 1.0))
    place = np.column_stack([middle, half])
    apart2 = np.sum((place[:, None] - place[None]) ** 2, axis=2)
    # facets at grazing angles cause the largest shifts; the factor is one at a phase angle of 90°
    size = np.minimum(0.5 / np.cos(half) ** 2, LARGEST)
    same = seen.which[:, None] == seen.which[None]
    shared = np.where(seen.line[:, None] == seen.line[None], 1.0, SHARED)
    return np.where(same, shared * np.exp(-0.5 * apart2 / REACH**2), 0.0) * size * size[:, None]


def posterior(seen: Phases) -> Sky:
    """The posterior of pole, sidereal frequency and cycles per turn.

    Phases are Gaussian with their measurement errors and with shifts by the shape
    (`shape_covariance`) of unknown size, 3°, 10° or 30°. Frequency and the constants of all lines
    are integrated out under flat priors. Poles, multiples 1, 2 and 4, sizes and the two symmetries
    have equal prior probabilities. The likelihood is raised to the power of one over the number of
    passes, because the same shape shifts the phase in all passes and the shifts do not average out
    (the coverage is given in benchmarks/RESULTS.md).
    """
    from lcbayes.physics.bodies.facets import grid  # here, so that periods alone need no JAX

    coarse = grid(COARSE)
    evaluated = _evaluate(coarse, seen)
    total = _log_sum(evaluated[0], axis=(1, 2, 3))
    kept = total > total.max() - DEEP
    if kept.sum() < 0.5 * COARSE:
        fine = grid(FINE)
        spacing = np.sqrt(4 * np.pi / COARSE)
        near = KDTree(coarse[kept]).query(fine, distance_upper_bound=1.2 * spacing)[0]
        poles, cell = fine[np.isfinite(near)], 4 * np.pi / FINE
        evaluated = _evaluate(poles, seen)
    else:
        poles, cell = coarse, 4 * np.pi / COARSE
    log_w, slope, variance, chi2 = evaluated
    worth = POWER / len(np.unique(seen.which))
    w = np.exp(worth * (log_w - log_w.max()))
    w /= w.sum()
    weight = w.sum(axis=(2, 3))
    safe = np.maximum(weight, 1e-300)
    m = np.array(MULTIPLES)[None]
    mean = np.sum(w * slope, axis=(2, 3)) / safe
    second = np.sum(w * (variance / worth + slope**2), axis=(2, 3)) / safe
    size = float(np.sum(w.sum(axis=(0, 1, 3)) * np.array(SHAPE_DEG)))
    by = w.sum(axis=(0, 1, 2))
    return Sky(
        poles,
        cell,
        weight,
        (seen.base + mean / (2 * np.pi)) / m,
        np.sqrt(np.maximum(second - mean**2, 0.0)) / (2 * np.pi) / m,
        {name: float(x) for name, x in zip(SYMMETRIES, by, strict=True)},
        size,
        float(chi2[np.unravel_index(np.argmax(w), w.shape)]),
        len(seen.t) - seen.constants.shape[1] - 3,
    )


def _evaluate(poles: Floats, seen: Phases) -> tuple[Floats, Floats, Floats, Floats]:
    """Log weight, slope of the phase (rad/s), its variance and χ², (G, M, S, 3) each."""
    shift = shape_covariance(seen)
    x = np.column_stack([seen.t, seen.constants])
    shape = (len(poles), len(MULTIPLES), len(SHAPE_DEG), len(SYMMETRIES))
    log_w, slope, variance, chi2 = (np.empty(shape) for _ in range(4))
    known: dict[tuple, Floats] = {}
    for i, m in enumerate(MULTIPLES):
        azimuth = [_symmetric(poles, seen, s, m, known) for s in SYMMETRIES]
        for j, size in enumerate(SHAPE_DEG):
            c = np.diag(seen.error**2) + (m * np.radians(size)) ** 2 * shift
            low = np.linalg.cholesky(c + 1e-14 * np.eye(len(c)))
            white = np.linalg.solve(low, x)
            q, r = np.linalg.qr(white)
            spread = np.linalg.inv(r.T @ r)
            constant = -np.log(np.diag(low)).sum() - np.log(np.abs(np.diag(r))).sum()
            for k, angle in enumerate(azimuth):
                z = np.linalg.solve(low, (seen.phase + m * angle).T)  # (W, G)
                inside = q.T @ z
                left = np.sum(z**2, axis=0) - np.sum(inside**2, axis=0)
                log_w[:, i, j, k] = constant - 0.5 * left
                chi2[:, i, j, k] = left
                slope[:, i, j, k] = np.linalg.solve(r, inside)[0]
                variance[:, i, j, k] = spread[0, 0]
    return log_w, slope, variance, chi2


def _log_sum(values: Floats, axis: tuple[int, ...]) -> Floats:
    top = values.max()
    return top + np.log(np.exp(values - top).sum(axis=axis) + 1e-300)
