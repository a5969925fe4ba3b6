"""A curve that contradicts the others, such as one whose times are wrong.

A curve whose clock is an hour late, or whose days begin at noon, may make a wrong period the most
probable, and turns the pole where it does not. Its residuals need not show it, because a body seen
in a few nights may fit them all. Therefore each curve is moved in time at the best periods of the
others, and the posterior of the periods is compared with that without the curve.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from lcbayes.inversion.attitude_scan import evidence, maxima
from lcbayes.inversion.attitude_scan.evidence import Cells
from lcbayes.inversion.attitude_scan.harmonics import SparsePoints
from lcbayes.inversion.attitude_scan.sparse import (
    LISTED,
    SAME_POLE,
    UNIQUE,
    SparseSearch,
    Spin,
    most_probable_first,
    same_period,
)

Floats = NDArray[np.float64]

PERIODS, POLES = 64, 2  # the best periods, and cells of each, that are compared
TRIED = 4  # the best periods of the other curves at which a curve is moved
PHASES = 24  # of a turn by which it is moved
BETTER = 10.0  # nats by which an unknown shift must raise the evidence
RIVAL = 3.0  # nats; curves whose shifts raise it by nearly as much may be the wrong one instead


@dataclass(frozen=True)
class Contradiction:
    """A curve that contradicts the others, and the spins without it.

    curves : counted from 0, the most probable first, of which one contradicts the others
    poles, frequencies : (P, 3) and (P,) Hz, of one period, the most probable first
    shares : (P,), of the probability of this period
    probability : of this period without the first of these curves
    moved : whether this curve agrees with the others once it is moved in time
    agree : probability that no curve contradicts the others
    """

    curves: tuple[int, ...]
    poles: Floats
    frequencies: Floats
    shares: Floats
    probability: float
    moved: bool
    agree: float

    @property
    def frequency(self) -> float:
        """Hz, of the most probable spin without the curve."""
        return float(self.frequencies[0])

    def doubted(self, found: SparseSearch, span: float) -> SparseSearch:
        """The search with the probabilities of its spins times ``agree``.

        The spins of the period without the curve share the rest, as before. If there is none, those
        without the curve have it.
        """
        rest = (1.0 - self.agree) * self.probability
        same = same_period([s.frequency for s in found.spins], self.frequency, span)
        total = sum(s.probability for s, is_same in zip(found.spins, same, strict=True) if is_same)
        spins = []
        for s, is_same in zip(found.spins, same, strict=True):
            more = rest if is_same else 0.0
            own = s.probability * (self.agree + more / total if is_same else self.agree)
            of_period = s.period_probability * self.agree + more
            spins.append(replace(s, probability=own, period_probability=of_period))
        if not same.any():
            best = found.spins[0].log_evidence
            added = zip(self.poles, self.frequencies, rest * self.shares, strict=True)
            spins += [Spin(pole, float(f), float(p), best, rest) for pole, f, p in added]
        return replace(found, spins=most_probable_first(spins))


def compared(
    points: SparsePoints, found: SparseSearch
) -> tuple[SparseSearch, Contradiction | None]:
    """A search with the probabilities that a contradiction leaves, and the contradiction."""
    against = contradiction(points, found.cells)
    return (found if against is None else against.doubted(found, points.span)), against


def contradiction(points: SparsePoints, found: Cells) -> Contradiction | None:
    """The curve whose times are wrong, or without which another period is called unique.

    An unknown shift of one curve, all parts of a turn being as probable, is a model with an
    evidence of its own. The times are called wrong if it is greater by ten nats, which outweighs
    odds of twenty thousand to one that the times of a curve are right.

    Parameters
    ----------
    points : SparsePoints
    found : Cells
        Those that hold the posterior of all points.

    Returns
    -------
    Contradiction or None
        None if no curve contradicts the others.
    """
    n_curves = points.group.shape[1]
    if n_curves == 1:
        return None
    spins = found.rows(np.concatenate(evidence.best_of_periods(found, points.span, PERIODS, POLES)))
    every = evidence.all_shapes(points, spins.pole, spins.frequency)
    as_it_is = evidence.all_shapes(points, *_maxima(points, spins, every)).max()
    raised, moved, left_out = np.zeros(n_curves), [], []
    for k in range(n_curves):
        others = _without(points, k)
        value = evidence.all_shapes(others, spins.pole, spins.frequency)
        poles, frequencies = _maxima(others, spins, value)
        shifted = _moved(points, k, poles, frequencies)
        i, j = np.argmax(shifted), np.argmax(value)
        raised[k] = shifted[i] - as_it_is
        moved.append(_spin(spins, value, poles[i], frequencies[i], points.span))
        left_out.append(_spin(spins, value, spins.pole[j], spins.frequency[j], points.span))
    order = [int(k) for k in np.argsort(raised)[::-1]]
    most = raised[order[0]]
    if most >= BETTER:
        near = tuple(k for k in order if raised[k] > most - RIVAL or n_curves == 2)
        agree = float(expit(BETTER - most))
        return _named(points, near, moved[order[0]], moved=True, agree=agree)
    first = spins.frequency[np.argmax(every)]
    other = [k for k in order if not same_period(left_out[k][1], first, points.span)]
    k = max(other, key=lambda k: left_out[k][2], default=None)
    if k is None or left_out[k][2] < UNIQUE:
        return None
    return _named(points, (k,), left_out[k], moved=False, agree=1.0 - left_out[k][2])


def _named(
    points: SparsePoints,
    curves: tuple[int, ...],
    without: tuple[Floats, float, float],
    *,
    moved: bool,
    agree: float,
) -> Contradiction:
    """A contradiction, from pole, frequency and probability without the first of the curves."""
    pole, frequency, probability = without
    spins = _of_period(points, curves[0], pole, frequency)
    return Contradiction(curves, *spins, probability, moved, agree)


def _without(points: SparsePoints, curve: int) -> SparsePoints:
    return points._replace(used=points.used * (1.0 - points.group[:, curve]))


def _of_period(
    points: SparsePoints, curve: int, pole: Floats, frequency: float
) -> tuple[Floats, Floats, Floats]:
    """Poles (P, 3), frequencies (P,) and shares (P,) of all spins of a period without a curve.

    The share of a spin is that of its evidence. An object near the ecliptic has a second pole,
    180 degrees away in longitude, that fits nearly as well.
    """
    others = _without(points, curve)
    at = maxima.near(others, pole[None], np.array([frequency]), (0.0, np.inf))
    left, chosen = same_period(at[1], frequency, points.span), []
    for i in np.argsort(-at[2], kind="stable"):
        if left[i]:
            chosen.append(i)
            left &= at[0] @ at[0][i] < np.cos(np.radians(SAME_POLE))
    poles, frequencies, value = (x[chosen] for x in at)
    share = np.exp(value - np.logaddexp.reduce(value))
    probable = share >= LISTED
    return poles[probable], frequencies[probable], share[probable] / share[probable].sum()


def _maxima(points: SparsePoints, spins: Cells, value: Floats) -> tuple[Floats, Floats]:
    """Poles and frequencies of the maxima uphill of the best cells of a few periods."""
    at = spins._replace(log_evidence=value)
    few = spins.rows(np.concatenate(evidence.best_of_periods(at, points.span, TRIED, POLES)))
    noise = maxima.Noise.of(points, evidence.fits(points, few.pole, few.frequency))
    return maxima.ascended(points, few.pole, few.frequency, noise)


def _moved(points: SparsePoints, curve: int, poles: Floats, frequencies: Floats) -> Floats:
    """ln of the evidence at spins (B,) with an unknown shift of a curve in time."""
    spins = poles.repeat(PHASES, axis=0), frequencies.repeat(PHASES)
    turns = np.tile(np.arange(PHASES) / PHASES, len(frequencies))
    value = evidence.all_shapes_moved(points, *spins, points.group[:, curve], turns)
    return np.logaddexp.reduce(value.reshape(-1, PHASES), axis=1) - np.log(PHASES)


def _spin(
    spins: Cells, value: Floats, pole: Floats, frequency: float, span: float
) -> tuple[Floats, float, float]:
    """Pole and frequency of a spin, and the probability of its period among those of the spins."""
    share = np.exp(value - np.logaddexp.reduce(value))
    probability = share[same_period(spins.frequency, frequency, span)].sum()
    return pole, float(frequency), float(probability)
