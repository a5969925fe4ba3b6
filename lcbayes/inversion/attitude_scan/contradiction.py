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
    SAME_PERIOD,
    UNIQUE,
    SparseSearch,
    Spin,
    most_probable_first,
)

Floats = NDArray[np.float64]

PERIODS, POLES = 64, 2  # the best periods, and cells of each, that are compared
TRIED = 4  # the best periods of the other curves at which a curve is moved
PHASES = 24  # of a turn by which it is moved
BETTER = 10.0  # nats by which an unknown shift must raise the evidence
RIVAL = 3.0  # nats; curves whose shifts raise it by nearly as much may be the wrong one instead


@dataclass(frozen=True)
class Contradiction:
    """A curve that contradicts the others, and the spin without it.

    curves : counted from 0, the most probable first, of which one contradicts the others
    pole, frequency : (3,) and Hz
    probability : of that period without the first of these curves
    moved : whether this curve agrees with the others once it is moved in time
    agree : probability that no curve contradicts the others
    """

    curves: tuple[int, ...]
    pole: Floats
    frequency: float
    probability: float
    moved: bool
    agree: float

    def doubted(self, found: SparseSearch, span: float) -> SparseSearch:
        """The search with the probabilities of its spins times ``agree``.

        The spins of the period without the curve share the rest, as before. If there is none, the
        one without the curve has it.
        """
        rest = (1.0 - self.agree) * self.probability
        same = _same(np.array([s.frequency for s in found.spins]), self.frequency, span)
        total = sum(s.probability for s, is_same in zip(found.spins, same, strict=True) if is_same)
        spins = []
        for s, is_same in zip(found.spins, same, strict=True):
            more = rest if is_same else 0.0
            own = s.probability * (self.agree + more / total if is_same else self.agree)
            of_period = s.period_probability * self.agree + more
            spins.append(replace(s, probability=own, period_probability=of_period))
        if not same.any():
            best = found.spins[0].log_evidence
            spins.append(Spin(self.pole, self.frequency, rest, best, rest))
        return replace(found, spins=most_probable_first(spins, span))


def contradiction(points: SparsePoints, found: Cells) -> Contradiction | None:
    """The curve whose times are wrong, or without which another period is called unique.

    An unknown shift of one curve, all parts of a turn being as probable, is a model with an
    evidence of its own. The times are called wrong if it is greater by ten nats. Both models would
    then be as probable if one curve in twenty thousand had wrong times.

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
    first = spins.frequency[np.argmax(every)]
    as_it_is = evidence.all_shapes(points, *_maxima(points, spins, every)).max()
    raised, shifted, without, most = [], [], None, UNIQUE
    for k in range(n_curves):
        others = points._replace(used=points.used * (1.0 - points.group[:, k]))
        value = evidence.all_shapes(others, spins.pole, spins.frequency)
        poles, frequencies = _maxima(others, spins, value)
        moved = _moved(points, k, poles, frequencies)
        raised.append(moved.max() - as_it_is)
        shifted.append((value, poles[np.argmax(moved)], frequencies[np.argmax(moved)]))
        frequency = spins.frequency[np.argmax(value)]
        probability = _probability(spins, value, frequency, points.span)
        if probability >= most and not _same(first, frequency, points.span):
            most = probability
            at = spins.pole[np.argmax(value)], float(frequency), probability
            without = Contradiction((k,), *at, moved=False, agree=1.0 - probability)
    if max(raised) < BETTER:
        return without
    order = [int(k) for k in np.argsort(raised)[::-1]]
    near = [k for k in order if raised[k] > max(raised) - RIVAL or n_curves == 2]
    value, pole, frequency = shifted[near[0]]
    at = pole, float(frequency), _probability(spins, value, frequency, points.span)
    agree = float(expit(BETTER - max(raised)))
    return Contradiction(tuple(near), *at, moved=True, agree=agree)


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


def _probability(spins: Cells, value: Floats, frequency: float, span: float) -> float:
    """Of the period of a frequency, among those of the spins."""
    share = np.exp(value - np.logaddexp.reduce(value))
    return float(share[_same(spins.frequency, frequency, span)].sum())


def _same(frequency: Floats, other: float, span: float) -> NDArray[np.bool_]:
    return np.abs(frequency - other) * span < SAME_PERIOD
