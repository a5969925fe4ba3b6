"""Observers and calibrations: which points share a clock, and which share a zero point."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lcbayes.data.lightcurve import LightCurve
from lcbayes.data.segments import PASS, Gap, split

Floats = NDArray[np.float64]
Index = NDArray[np.int64]

NIGHT_GAP_S = 6 * 3600.0  # without points of an observer: a new night with a new calibration
MAX_RATE = np.radians(3.0)  # rad/s; from the ground, a satellite at 200 km moves at 2.2 deg/s
MIN_TRACK = 4  # times of an observer in a pass; fewer do not show that it is one
MIN_JUMP = np.radians(0.5)  # of the direction to the observer; parallax of two sites 10 km apart


class Observers(NamedTuple):
    """Observers of a light curve.

    Attributes
    ----------
    index : (T,) int
        Observer of each point.
    names : tuple of str
        Name of each observer.
    source : "site", "directions" or "none"
        How they are known: from the column of sites, from directions that one observer cannot have
        at the same time, or not at all, in which case one observer is assumed.
    """

    index: Index
    names: tuple[str, ...]
    source: str


def observers(curve: LightCurve) -> Observers:
    """The observers of a light curve.

    If no site is named, points that follow one another so closely that the direction to one
    observer cannot have changed by as much as it did belong to several observers. Each point then
    belongs to the observer whose last direction is nearest. Observers of different passes count as
    different, because the directions do not identify them. If this leaves an observer with points
    at fewer than `MIN_TRACK` times of a pass, the directions belong to no set of observers on the
    ground, and one observer is assumed.

    Examples
    --------
    >>> import numpy as np
    >>> a, b = [0.0, 0.6, 0.8], [0.0, 0.8, 0.6]          # 16 deg apart
    >>> curve = LightCurve(t=np.arange(8.0), brightness=np.ones(8), error=None,
    ...     sun=np.tile([1.0, 0.0, 0.0], (8, 1)), obs=np.array([a, b] * 4))
    >>> observers(curve).index.tolist()
    [0, 1, 0, 1, 0, 1, 0, 1]
    """
    if np.any(curve.site != ""):
        names, index = np.unique(curve.site, return_inverse=True)
        return Observers(index.astype(np.int64), tuple(map(str, names)), "site")
    index = np.zeros(curve.n_obs, np.int64)
    passes = split(curve.t, np.zeros(curve.n_obs, np.int64), PASS)
    tracks = [_tracks(curve.t[rows], curve.obs[rows]) for rows in passes]
    several = [_n_times(curve.t[r], k) for r, k in zip(passes, tracks, strict=True) if k.max()]
    if not several or min(n.min() for n in several) < MIN_TRACK:
        return Observers(index, ("",), "none")
    names = []
    for i, (rows, track) in enumerate(zip(passes, tracks, strict=True)):
        index[rows] = len(names) + track
        where = f" of pass {i + 1}" if len(passes) > 1 else ""
        names += [f"observer {k + 1}{where}" for k in range(track.max() + 1)]
    return Observers(index, tuple(names), "directions")


def _tracks(t: Floats, obs: Floats) -> Index:
    """Observer of each point of a pass, points in order of time: (T,), from 0."""
    track = np.zeros(t.size, np.int64)
    steps = np.arccos(np.clip(np.sum(obs[1:] * obs[:-1], axis=1), -1.0, 1.0))
    if np.all(steps <= MIN_JUMP + MAX_RATE * np.diff(t)):
        return track
    last_t, last_obs = [t[0]], [obs[0]]
    for k in range(1, t.size):
        angle = np.arccos(np.clip(np.array(last_obs) @ obs[k], -1.0, 1.0))
        possible = angle <= MIN_JUMP + MAX_RATE * (t[k] - np.array(last_t))
        if not possible.any():
            track[k] = len(last_t)
            last_t.append(t[k])
            last_obs.append(obs[k])
            continue
        best = int(np.argmin(np.where(possible, angle, np.inf)))
        track[k], last_t[best], last_obs[best] = best, t[k], obs[k]
    return track


def _n_times(t: Floats, track: Index) -> Index:
    """Number of different times of each observer of a pass."""
    return np.bincount(np.unique(np.stack([track, t]), axis=1)[0].astype(np.int64))


class Calibrations(NamedTuple):
    """Groups of points that share a zero point: one curve, observer and night.

    Attributes
    ----------
    index : (T,) int
        Group of each point; −1 if the point needs no zero point, because its curve has an unknown
        scale and no other group.
    names : tuple of str
        Name of each group.
    first, last : (G,) s
        Times of the first and the last point of each group.
    series : (G,) int
        Series of each group: one curve and observer, in any night. 0 if they have no names.
    series_names : tuple of str
        Name of each series; none unless there are several series, of which one has several nights.
    """

    index: Index
    names: tuple[str, ...]
    first: Floats
    last: Floats
    series: Index
    series_names: tuple[str, ...]


def calibrations(curve: LightCurve, seen_by: Observers) -> Calibrations:
    """The groups of a light curve that share a zero point.

    They are numbered by curve, observer and time. One group alone has no zero point: it could not
    be distinguished from the size of the body.
    """
    series = curve.curve * len(seen_by.names) + seen_by.index
    order = np.lexsort((curve.t, series))
    new = np.diff(series[order]) != 0
    new |= np.diff(curve.t[order]) > NIGHT_GAP_S
    group = np.empty(curve.n_obs, np.int64)
    group[order] = np.concatenate([[0], np.cumsum(new)])
    first = np.array([np.flatnonzero(group == g)[0] for g in range(group.max() + 1)])
    of_curve = curve.curve[first]
    alone = np.bincount(of_curve, minlength=curve.n_curves)[of_curve] == 1
    needed = np.flatnonzero(~(alone & curve.free_scale[of_curve]))
    if needed.size < 2:
        none = np.zeros(0)
        return Calibrations(np.full(curve.n_obs, -1), (), none, none, none.astype(np.int64), ())
    number = np.full(group.max() + 1, -1)
    number[needed] = np.arange(needed.size)
    rows = [np.flatnonzero(group == g) for g in needed]
    nights = _nights(series[first], needed)
    names = tuple(
        _name(curve, seen_by, int(r[0]), night) for r, night in zip(rows, nights, strict=True)
    )
    begin, end = (np.array([f(curve.t[r]) for r in rows]) for f in (np.min, np.max))
    _, its_first, own = np.unique(series[first][needed], return_index=True, return_inverse=True)
    series_names = tuple(_name(curve, seen_by, int(rows[g][0]), 0) for g in its_first)
    if not 1 < len(series_names) < needed.size:
        own, series_names = np.zeros_like(own), ()
    return Calibrations(number[group], names, begin, end, own, series_names)


def _nights(series: Index, needed: Index) -> list[int]:
    """Number of the night of each needed group among those of its series; 0 if it has only one."""
    numbers = []
    for g in needed:
        same = np.flatnonzero(series == series[g])
        numbers.append(int(np.searchsorted(same, g)) + 1 if same.size > 1 else 0)
    return numbers


def _name(curve: LightCurve, seen_by: Observers, row: int, night: int) -> str:
    parts = [
        curve.curve_titles[curve.curve[row]] if curve.n_curves > 1 else "",
        seen_by.names[seen_by.index[row]],
        f"night {night}" if night else "",
    ]
    return ", ".join(p for p in parts if p)


class Matched(NamedTuple):
    """Observers and calibrations of the points of a curve among those of the fitted curve.

    Attributes
    ----------
    observer : (T,) int
        The number of observers denotes another one.
    calibration : (T,) int
        The number of calibrations denotes another one, −1 none. A point of another curve belongs
        to the calibration of the same curve and observer in the same night.
    series : (T,) int
        The number of series denotes another one.
    observers, calibrations
        Those of the fitted curve.
    """

    observer: Index
    calibration: Index
    series: Index
    observers: Observers
    calibrations: Calibrations


def matched(wanted: LightCurve, times: Floats, fitted: LightCurve) -> Matched:
    """The observers and calibrations of a curve.

    Parameters
    ----------
    wanted : LightCurve
    times : (T,) s
        Times of ``wanted`` on the time axis of ``fitted.t``.
    fitted : LightCurve
    """
    known = observers(fitted)
    groups = calibrations(fitted, known)
    n_series = len(groups.series_names)
    if wanted is fitted:
        series = np.append(groups.series, n_series)[groups.index]
        return Matched(known.index, groups.index, series, known, groups)
    names = {name: i for i, name in enumerate(known.names)}
    if known.source == "directions":
        names = {}
    observer = np.array([names.get(str(s), len(known.names)) for s in wanted.site], np.int64)
    calibration = np.full(wanted.n_obs, len(groups.names) if groups.names else -1, np.int64)
    series = np.full(wanted.n_obs, n_series, np.int64)
    labels = np.array(wanted.curve_names)[wanted.curve]
    for g in range(len(groups.names)):
        row = int(np.flatnonzero(groups.index == g)[0])
        name = fitted.curve_names[fitted.curve[row]]
        near = (times > groups.first[g] - NIGHT_GAP_S) & (times < groups.last[g] + NIGHT_GAP_S)
        same = ((labels == name) | (fitted.n_curves == 1)) & (observer == known.index[row])
        calibration[near & same] = g
        series[same] = groups.series[g]
    return Matched(observer, calibration, series, known, groups)


class Nights(NamedTuple):
    """Points of any observer without a gap of `NIGHT_GAP_S`.

    Attributes
    ----------
    index : (T,) int
        Night of each point; the number of nights denotes one without fitted points.
    elapsed : (T,) s
        Time since the middle of the night.
    number : int
    longest : s
        Length of the longest night.
    """

    index: Index
    elapsed: Floats
    number: int
    longest: float


def matched_nights(times: Floats, fitted: LightCurve) -> Nights:
    """Nights of the fitted curve to which times (T,) s belong, on the time axis of ``fitted.t``."""
    parts = split(fitted.t, np.zeros(fitted.n_obs, np.int64), Gap(NIGHT_GAP_S))
    index, elapsed = np.full(times.size, len(parts)), times - times.min()
    for k, rows in enumerate(parts):
        first, last = fitted.t[rows[0]], fitted.t[rows[-1]]
        here = (times > first - NIGHT_GAP_S) & (times < last + NIGHT_GAP_S)
        index[here], elapsed[here] = k, times[here] - 0.5 * (first + last)
    longest = max(float(np.ptp(fitted.t[rows])) for rows in parts)
    return Nights(index, elapsed, len(parts), longest)


def direction_rates(curve: LightCurve, seen_by: Observers) -> tuple[Floats, Floats]:
    """Rates of change (T, 3), 1/s, of the directions to Sun and observer.

    They are differences of neighbouring points of one observer in one pass, and zero if a point has
    no neighbour at another time.
    """
    rates = np.zeros((2, curve.n_obs, 3))
    for rows in split(curve.t, seen_by.index, PASS):
        t, first = np.unique(curve.t[rows], return_index=True)
        if t.size < 2:
            continue
        back = np.searchsorted(t, curve.t[rows])
        for k, vectors in enumerate((curve.sun, curve.obs)):
            rates[k, rows] = np.gradient(vectors[rows[first]], t, axis=0)[back]
    return rates[0], rates[1]
