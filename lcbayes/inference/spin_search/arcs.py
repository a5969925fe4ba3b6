"""Arcs of a light curve: parts so short that they tell only a few hundred rates apart."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.data.segments import PASS, split
from lcbayes.modelling.epochs import Epochs

Floats = NDArray[np.float64]

MAX_RATES = 256.0  # largest product of an arc's duration and the fastest rate, rad
RESOLVED = 0.5  # rad that the body may turn between points before these are averaged


class Points(NamedTuple):
    """Brightness as flux at unit distance, in full sunlight, in order of time.

    Attributes
    ----------
    t : (T,) s
    sun, obs : (T, 3)
    flux, error : (T,) m²
    series : (T,) int
        Points of one series have one observer and scale.
    epoch : (T,) int
        Index in the light curve; of averaged points, that of the first.
    """

    t: Floats
    sun: Floats
    obs: Floats
    flux: Floats
    error: Floats
    series: NDArray[np.int64]
    epoch: NDArray[np.int64]

    def at(self, rows: NDArray) -> Points:
        """Some of the points."""
        return Points._make(x[rows] for x in self)

    @classmethod
    def of(cls, data: Epochs) -> Points:
        """The points of a light curve; those in shadow are left out.

        Curves of unknown scale are brought to a mean of one.
        """
        flux, error = data.as_flux()
        order = np.argsort(np.asarray(data.t), kind="stable")
        keep = order[np.isfinite(error[order])]
        t, sun, obs = (np.asarray(x)[keep] for x in (data.t, data.sun, data.obs))
        labels = np.stack([np.asarray(data.curve), np.asarray(data.observer)], axis=1)
        series = np.unique(labels, axis=0, return_inverse=True)[1].ravel()[keep]
        return cls(t, sun, obs, flux[keep], error[keep], series, keep)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Arcs:
    """Points by arc, padded to one length with points of no weight.

    The arcs are in the order in which the search includes them: the closest pair first, then
    whichever is closest to those included.

    Attributes
    ----------
    middle : (A,) s
    span : (A,) s
        Time base of this and all earlier arcs.
    dt : (A, L) s
        Time since the arc's middle.
    sun, obs : (A, L, 3)
    weight : (A, L)
        1/error, m⁻².
    white : (A, L)
        Flux times weight.
    """

    middle: jax.Array
    span: jax.Array
    dt: jax.Array
    sun: jax.Array
    obs: jax.Array
    weight: jax.Array
    white: jax.Array

    @property
    def duration(self) -> float:
        """Length of the longest arc, s."""
        return float(2.0 * jnp.max(jnp.abs(self.dt)))

    @classmethod
    def whole(cls, points: Points, model_error: float) -> Arcs:
        """All points as one arc."""
        middle = 0.5 * (points.t[0] + points.t[-1])
        weight = 1.0 / np.hypot(points.error, model_error * abs(float(np.mean(points.flux))))
        rows = (points.t - middle, points.sun, points.obs, weight, points.flux * weight)
        return cls(
            jnp.asarray([middle]),
            jnp.asarray([np.ptp(points.t)]),
            *(jnp.asarray(x)[None] for x in rows),
        )

    @classmethod
    def of(cls, points: Points, max_rate: float, model_error: float) -> Arcs:
        """Arcs of a light curve.

        Parameters
        ----------
        points : Points
        max_rate : rad/s
            The fastest spin.
        model_error : float
            Error of the series, relative to the mean flux, added to the errors in quadrature.
        """
        rows = split(points.t, np.zeros(points.t.size, int), PASS)
        rows = [part for long in rows for part in _shortened(points.t, long, MAX_RATES / max_rate)]
        parts = [_averaged(points, r, RESOLVED / max_rate) for r in rows]
        floor = model_error * abs(float(np.mean(points.flux)))
        order = _growing([0.5 * (p.t[0] + p.t[-1]) for p in parts])
        parts = [parts[i] for i in order]
        longest = max(p.t.size for p in parts)
        middle = np.array([0.5 * (p.t[0] + p.t[-1]) for p in parts])
        ends = np.array([[p.t[0], p.t[-1]] for p in parts])
        span = np.maximum.accumulate(ends[:, 1]) - np.minimum.accumulate(ends[:, 0])

        def padded(values: list[Floats]) -> jax.Array:
            out = [np.concatenate([v, np.repeat(v[-1:], longest - len(v), 0)]) for v in values]
            return jnp.asarray(np.stack(out))

        inside = [np.arange(longest) < p.t.size for p in parts]
        weight = padded([1.0 / np.hypot(p.error, floor) for p in parts]) * jnp.asarray(inside)
        return cls(
            jnp.asarray(middle),
            jnp.asarray(span),
            padded([p.t for p in parts]) - middle[:, None],
            padded([p.sun for p in parts]),
            padded([p.obs for p in parts]),
            weight,
            padded([p.flux for p in parts]) * weight,
        )


def _shortened(t: Floats, rows: NDArray, longest: float) -> list[NDArray]:
    """Rows of equally long parts, none longer than a duration (s)."""
    n = max(1, int(np.ceil((t[rows[-1]] - t[rows[0]]) / longest)))
    edges = np.linspace(t[rows[0]], t[rows[-1]], n + 1)[1:-1]
    return [part for part in np.split(rows, np.searchsorted(t[rows], edges)) if part.size]


def _averaged(points: Points, rows: NDArray, window: float) -> Points:
    """The rows, with points of one series within a time window (s) averaged, in order of time."""
    group = np.floor((points.t[rows] - points.t[rows[0]]) / window).astype(int)
    group = group * (points.series.max() + 1) + points.series[rows]
    _, first, group = np.unique(group, return_index=True, return_inverse=True)
    weight = 1.0 / points.error[rows] ** 2
    total = np.bincount(group, weight)

    def mean(values: Floats) -> Floats:
        return np.bincount(group, weight * values) / total

    def direction(vectors: Floats) -> Floats:
        sums = np.stack([np.bincount(group, weight * column) for column in vectors.T], axis=1)
        return sums / np.linalg.norm(sums, axis=1, keepdims=True)

    t, flux = (mean(x[rows]) for x in (points.t, points.flux))
    sun, obs = (direction(x[rows]) for x in (points.sun, points.obs))
    series, epoch = (x[rows][first] for x in (points.series, points.epoch))
    averaged = Points(t, sun, obs, flux, 1.0 / np.sqrt(total), series, epoch)
    return averaged.at(np.argsort(t, kind="stable"))


def _growing(middle: list[float]) -> list[int]:
    """Indices of arcs, the closest pair first, then whichever is closest to those included."""
    if len(middle) == 1:
        return [0]
    t = np.asarray(middle)
    first = int(np.argmin(np.diff(np.sort(t))))
    chosen = [int(i) for i in np.argsort(t, kind="stable")[first : first + 2]]
    while len(chosen) < len(t):
        apart = np.abs(t[:, None] - t[chosen]).min(axis=1)
        apart[chosen] = np.inf
        chosen.append(int(np.argmin(apart)))
    return chosen
