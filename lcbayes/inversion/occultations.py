"""Outlines of convex bodies over the chords of occultations: size, place and likelihood."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, log_softmax, logsumexp, softmax

from lcbayes.data.formats.occultation import Occultation
from lcbayes.geometry.sky_plane import west_north
from lcbayes.physics.attitude.spin_state import SpinState

Floats = NDArray[np.float64]

DIRECTIONS = 360  # of the support function; an outline of 80 km is off by 0.4 m between them
RELIEF = np.geomspace(0.003, 0.3, 14)  # rms height of the limb over the model ÷ radius
RELIEF_MEDIAN, RELIEF_LOG_SD = 0.03, 1.0  # of its log-normal prior
RELIEF_LENGTH = 0.35  # rad along the limb, over which heights are correlated
WHITE = 0.1  # share of the variance of the heights that is not correlated
ITERATIONS = 30
BOUND = 1e-7  # relative change of the size at which the iteration ends


def _unit_circle(count: int = DIRECTIONS) -> Floats:
    angle = 2.0 * np.pi * np.arange(count) / count
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def support(vertices: Floats, spin: SpinState, event: Occultation) -> tuple[Floats, Floats]:
    """The support function of the outline at the middle of each chord, h(n) = max v·n.

    The body is projected along the line of sight, so the star is at infinity behind the asteroid.

    Parameters
    ----------
    vertices : (V, 3)
        Body frame.
    spin : SpinState
        In ecliptic J2000.
    event : Occultation

    Returns
    -------
    outline : (C, DIRECTIONS)
        In directions 2π j/DIRECTIONS from x (west) to y (north).
    across : (C, 2)
        In the two directions perpendicular to the chord, left of its direction first.
    """
    rotation = spin.rotation(event.body_jd)
    plane = np.einsum("ij,cjk->cik", west_north(event.to_earth_km), rotation)  # (C, 2, 3)
    flat = np.einsum("cik,vk->cvi", plane, vertices)
    outline = np.max(flat @ _unit_circle().T, axis=1)
    along = event.direction
    left = np.stack([-along[:, 1], along[:, 0]], axis=1)
    offset = np.einsum("cvi,ci->cv", flat, left)
    return outline, np.stack([offset.max(axis=1), -offset.min(axis=1)], axis=1)


@dataclass(frozen=True)
class Chords:
    """The chords of all events as the fit needs them.

    Attributes
    ----------
    ends : (E, 2) km
        Ends of the positive chords.
    along_km : (E, 2)
        Timing error of each end as a vector along its chord.
    chord : (E,)
        Index of the chord of each end, among the chords of all events.
    event, chord_event : (E,), (C,)
        Event of each end, and of each chord.
    negative : (G,)
        Indices of the negative chords.
    offset_km, left : (C,), (C, 2)
        Each chord as the line left · p = offset.
    """

    ends: Floats
    along_km: Floats
    chord: NDArray[np.integer]
    event: NDArray[np.integer]
    chord_event: NDArray[np.integer]
    negative: NDArray[np.integer]
    offset_km: Floats
    left: Floats

    @classmethod
    def of(cls, events: Sequence[Occultation]) -> Chords:
        """The chords of the events, in their order."""
        place = np.concatenate([e.place_km for e in events])
        error = np.concatenate([e.error_km for e in events])
        along = np.concatenate([e.direction for e in events])
        which = np.repeat(np.arange(len(events)), [len(e.negative) for e in events])
        negative = np.concatenate([e.negative for e in events])
        chord = np.repeat(np.flatnonzero(~negative), 2)
        left = np.stack([-along[:, 1], along[:, 0]], axis=1)
        return cls(
            ends=place[~negative].reshape(-1, 2),
            along_km=(error[~negative][..., None] * along[~negative][:, None]).reshape(-1, 2),
            chord=chord,
            event=which[chord],
            chord_event=which,
            negative=np.flatnonzero(negative),
            offset_km=np.einsum("ci,ci->c", left, place.mean(axis=1)),
            left=left,
        )


@dataclass(frozen=True)
class Placed:
    """Bodies fitted to the chords, for one height of the relief or the most probable one.

    Attributes
    ----------
    size : (S,) km per unit of the bodies' lengths
    size_sd : (S,)
    centre : (S, K, 2) km
        Of each event.
    relief : (S,)
        Rms height of the limb over the model ÷ radius.
    distance : (S, E) km
        From the outline to each end, positive outside.
    depth : (S, G) km
        Of the negative chords in the outline; negative if they miss it.
    log_likelihood : (S,)
        ln p(chords | body), integrated over size and centre, and over the relief in `place`.
    """

    size: Floats
    size_sd: Floats
    centre: Floats
    relief: Floats
    distance: Floats
    depth: Floats
    log_likelihood: Floats


def place(outline: Floats, across: Floats, chords: Chords) -> Placed:
    """Fit the size of each body and the centre of each event to the chords.

    The signed distance of an end p from the outline s K + c is d = maxₙ [n·(p − c) − s h(n)] with
    the support function h of the body K, so ∂d/∂c = −n and ∂d/∂s = −h(n) at the nearest point. d
    has the timing error times its direction cosine with n, and the height of the limb over the
    model: rms f r with r the mean of s h, of which nine tenths are correlated as exp(−Δ²/2ℓ²) with
    Δ the chord of the angle between the normals and ℓ = 0.35. ln f ~ Normal(ln 0.03, 1); f is
    summed over a grid. A negative chord of depth δ has the probability Φ(−δ/σ) with σ = f r. Size
    and centres are integrated by Laplace's method with priors 1/s and uniform; s and c are
    Gauss-Newton optima.

    Parameters
    ----------
    outline, across : (S, C, DIRECTIONS), (S, C, 2)
        `support` of each body, lengths in any unit that is common to all.
    chords : Chords

    Returns
    -------
    Placed
        For each body at its most probable f; ``size_sd`` includes the spread over f.
    """
    size, centre = _start(outline, chords)
    each: list[Placed] = []
    for f in RELIEF[::-1]:
        each.append(_at_relief(outline, across, chords, float(f), size, centre))
        size, centre = each[-1].size, each[-1].centre
    each.reverse()
    prior = -0.5 * (np.log(RELIEF / RELIEF_MEDIAN) / RELIEF_LOG_SD) ** 2
    log_joint = np.stack([p.log_likelihood for p in each]) + log_softmax(prior)[:, None]
    total = np.asarray(logsumexp(log_joint, axis=0))
    weight = np.exp(log_joint - total)
    sizes, sds = np.stack([p.size for p in each]), np.stack([p.size_sd for p in each])
    mean = np.sum(weight * sizes, axis=0)
    variance = np.sum(weight * (sds**2 + (sizes - mean) ** 2), axis=0)
    best = np.argmax(log_joint, axis=0)
    row = np.arange(len(best))

    def chosen(name: str) -> Floats:
        return np.stack([getattr(p, name) for p in each])[best, row]

    return Placed(
        size=mean,
        size_sd=np.sqrt(variance),
        centre=chosen("centre"),
        relief=np.sum(weight * RELIEF[:, None], axis=0),
        distance=chosen("distance"),
        depth=chosen("depth"),
        log_likelihood=total,
    )


def _start(outline: Floats, chords: Chords) -> tuple[Floats, Floats]:
    """Sizes (S,) and centres (S, K, 2) from the mean place of the ends and their mean distance."""
    events = int(chords.chord_event.max()) + 1
    middle = np.stack([chords.ends[chords.event == k].mean(axis=0) for k in range(events)])
    reach = np.linalg.norm(chords.ends - middle[chords.event], axis=1)
    size = reach.mean() / outline.mean(axis=(1, 2))
    return size, np.tile(middle, (len(outline), 1, 1))


def _at_relief(
    outline: Floats,
    across: Floats,
    chords: Chords,
    relief: float,
    size: Floats,
    centre: Floats,
) -> Placed:
    """`place` for one f, by Gauss-Newton steps from these sizes and centres."""
    count, events = centre.shape[:2]
    for _ in range(ITERATIONS):
        system = _System.at(outline, across, chords, relief, size, centre)
        step = system.step()
        smallest = 0.2 * size
        new = np.maximum(size + step[:, 0], smallest)
        centre = centre + step[:, 1:].reshape(count, events, 2)
        done = np.max(np.abs(new / size - 1.0)) < BOUND
        size = new
        if done:
            break
    system = _System.at(outline, across, chords, relief, size, centre)
    covariance = np.linalg.inv(system.curvature)
    log_determinant = np.linalg.slogdet(system.curvature)[1]
    return Placed(
        size=size,
        size_sd=np.sqrt(covariance[:, 0, 0]),
        centre=centre,
        relief=np.full(count, relief),
        distance=system.distance,
        depth=system.depth,
        log_likelihood=system.log_density - 0.5 * log_determinant - np.log(size),
    )


@dataclass(frozen=True)
class _System:
    """Normal equations of size and centres (S, 1 + 2K, …), and ln p of the chords there."""

    distance: Floats
    depth: Floats
    gradient: Floats
    curvature: Floats
    log_density: Floats

    def step(self) -> Floats:
        return np.linalg.solve(self.curvature, self.gradient[..., None])[..., 0]

    @classmethod
    def at(
        cls,
        outline: Floats,
        across: Floats,
        chords: Chords,
        relief: float,
        size: Floats,
        centre: Floats,
    ) -> _System:
        count, events = len(size), centre.shape[1]
        distance, normal, height = nearest(outline, chords, size, centre)
        jacobian = np.zeros((count, len(chords.ends), 1 + 2 * events))
        jacobian[:, :, 0] = -height
        for k in range(events):
            here = chords.event == k
            jacobian[:, here, 1 + 2 * k : 3 + 2 * k] = -normal[:, here]
        sigma = relief * size * outline.mean(axis=(1, 2))
        inverse, log_determinant = _precision(chords, normal, sigma)
        weighted = np.einsum("sef,sfj->sej", inverse, jacobian)
        curvature = np.einsum("sej,sek->sjk", weighted, jacobian)
        gradient = -np.einsum("sej,se->sj", weighted, distance)
        squares = np.einsum("se,sef,sf->s", distance, inverse, distance)
        log_density = -0.5 * (squares + log_determinant)
        depth, slope = _depths(across, chords, size, centre)
        if len(chords.negative):
            ratio = depth / sigma[:, None]
            log_density = log_density + log_ndtr(-ratio).sum(axis=1)
            hazard = np.exp(-0.5 * ratio**2 - log_ndtr(-ratio)) / np.sqrt(2.0 * np.pi)
            gradient -= np.einsum("sg,sgj->sj", hazard / sigma[:, None], slope)
            bend = hazard * np.maximum(hazard - ratio, 0.0) / sigma[:, None] ** 2
            curvature = curvature + np.einsum("sg,sgj,sgk->sjk", bend, slope, slope)
        return cls(distance, depth, gradient, curvature, log_density)


def nearest(
    outline: Floats, chords: Chords, size: Floats, centre: Floats
) -> tuple[Floats, Floats, Floats]:
    """Signed distance of each end from the outline, its normal there, and h of the normal.

    Returns
    -------
    distance : (S, E), positive outside
    normal : (S, E, 2)
    height : (S, E)
    """
    circle = _unit_circle()
    offset = chords.ends - centre[:, chords.event]
    values = offset @ circle.T - size[:, None, None] * outline[:, chords.chord]
    best = np.argmax(values, axis=2)
    distance = np.take_along_axis(values, best[..., None], 2)[..., 0]
    height = np.take_along_axis(outline[:, chords.chord], best[..., None], 2)[..., 0]
    return distance, circle[best], height


def _precision(chords: Chords, normal: Floats, sigma: Floats) -> tuple[Floats, Floats]:
    """Inverse and ln det of the covariance of the distances, (S, E, E) and (S,)."""
    timing = np.einsum("sei,ei->se", normal, chords.along_km)
    cosine = np.einsum("sei,sfi->sef", normal, normal)
    together = chords.event[:, None] == chords.event
    alike = np.exp((cosine - 1.0) / RELIEF_LENGTH**2) * together
    eye = np.eye(len(chords.ends))
    covariance = sigma[:, None, None] ** 2 * ((1.0 - WHITE) * alike + WHITE * eye)
    covariance += timing[:, :, None] ** 2 * eye
    return np.linalg.inv(covariance), np.linalg.slogdet(covariance)[1]


def _depths(across: Floats, chords: Chords, size: Floats, centre: Floats) -> tuple[Floats, Floats]:
    """Depth of the negative chords in the outline, (S, G), and its derivatives (S, G, 1 + 2K)."""
    lines = chords.negative
    events = chords.chord_event[lines]
    left, offset = chords.left[lines], chords.offset_km[lines]
    position = offset - np.einsum("sgi,gi->sg", centre[:, events], left)
    either = size[:, None, None] * across[:, lines]
    either = either + np.stack([-position, position], axis=2)
    side = np.argmin(either, axis=2)
    depth = np.take_along_axis(either, side[..., None], 2)[..., 0]
    slope = np.zeros((*depth.shape, 1 + 2 * centre.shape[1]))
    slope[..., 0] = np.take_along_axis(across[:, lines], side[..., None], 2)[..., 0]
    sign = np.where(side == 0, 1.0, -1.0)
    for g, k in enumerate(events):
        slope[:, g, 1 + 2 * k : 3 + 2 * k] = sign[:, g, None] * left[g]
    return depth, slope


def effective_number(log_weight: Floats) -> float:
    """The effective number of draws with these log weights, (Σ w)² / Σ w²."""
    return float(1.0 / np.sum(softmax(log_weight) ** 2))
