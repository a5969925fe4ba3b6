"""From the evidence of each number of facets to probabilities, and to one sentence about them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.reasons import Finding
from lcbayes.core.text import join_words

Floats = NDArray[np.float64]

DRAWS = 20_000  # of what the evidences may be
EXCLUDED_PROBABILITY = 0.05  # a number whose probability is below this, error and all, is excluded
MIN_ODDS = 2.0  # times the probability of the next: from here on one number stands out
MAX_INTERVAL = 0.5  # an interval of a probability wider than this says nothing


class Odds(NamedTuple):
    """Posterior probability of each number of facets, (K,) each."""

    probability: Floats
    low: Floats  # 5 and 95 % of what it may be, for the errors of the evidences
    high: Floats


def moderated(se: Floats) -> Floats:
    """Errors (K,) that a few runs gave, each drawn halfway to their common variance.

    Two or four runs agree by chance now and then, and an error of nothing decides everything. What
    makes runs differ is much the same for neighbouring numbers of facets, so the variance of each
    is taken as the mean of its own and that of all, with twice the degrees of freedom.

    References
    ----------
    Smyth 2004, Stat. Appl. Genet. Mol. Biol. 3, 3 (moderated t; here with equal weights).
    """
    return np.sqrt(0.5 * (se**2 + np.mean(se**2)))


def probabilities(log_evidence: Floats, se: Floats, n_runs: int, seed: int = 0) -> Odds:
    """p(N | y) ∝ Z_N under the same prior probability for each N.

    Facets have no names, and the prior is the same whatever their order. Z_N is an integral over
    all N! orders of every body, with a prior that integrates to one over all of them; each body
    has N! peaks of 1/N! the prior density, and the two cancel. So Z_N is the evidence as it
    stands: dividing it by N! would count the orders twice.

    Each ln Z_N has an error that is itself estimated from ``n_runs`` runs, so it is Student-t with
    2 (n_runs − 1) degrees of freedom (`moderated`); the interval is that of the probabilities when
    each ln Z_N is drawn from its own.

    Parameters
    ----------
    log_evidence, se : (K,)
        Under priors that integrate to one; errors as from `moderated`.
    """
    rng = np.random.default_rng(seed)
    error = rng.standard_t(2 * (n_runs - 1), (DRAWS, len(se))) * se
    low, high = np.quantile(_shares(log_evidence + error), [0.05, 0.95], axis=0)
    return Odds(_shares(log_evidence), low, high)


def _shares(log_evidence: Floats) -> Floats:
    share = np.exp(log_evidence - log_evidence.max(axis=-1, keepdims=True))
    return share / share.sum(axis=-1, keepdims=True)


class Verdict(NamedTuple):
    """What the probabilities say."""

    best: int
    rivals: list[int]  # that cannot be told from it
    possible: list[int]  # less probable, but not excluded
    sentence: str


def verdict(counts: Sequence[int], odds: Odds) -> Verdict:
    """The number of facets, or which numbers the data cannot tell from each other.

    A number is excluded whose probability is below 0.05, its error included. The best one stands
    out if it is at least twice as probable as the next and their intervals do not overlap.
    """
    order = [int(k) for k in np.argsort(-odds.probability, kind="stable")]
    top = order[0]
    left = [k for k in order[1:] if odds.high[k] > EXCLUDED_PROBABILITY]
    near = [
        k
        for k in left
        if MIN_ODDS * odds.probability[k] > odds.probability[top] or odds.high[k] > odds.low[top]
    ]
    far = [k for k in left if k not in near]

    def named(ks: Sequence[int]) -> str:
        return join_words([f"{counts[k]} ({_two(odds.probability[k])})" for k in ks])

    chance = _two(odds.probability[top])
    if near:
        alike = sorted([top, *near], key=lambda k: counts[k])
        *others, last = [str(counts[k]) for k in alike]
        chances = ", ".join(_two(odds.probability[k]) for k in alike)
        text = f"the data cannot tell {join_words(others)} from {last} facets ({chances})"
        if far:
            text += f", and {named(far)} cannot be excluded"
    else:
        verb = "is" if counts[top] == 1 else "are"
        text = f"{facets(counts[top])} {verb} most probable ({chance}); "
        text += f"{named(far)} cannot be excluded" if far else "no other number tried is likely"
    most = max(counts)
    if counts[top] == most or any(counts[k] == most for k in left):
        text += f"; more than {most} were not tried"
    return Verdict(
        counts[top], sorted(counts[k] for k in near), sorted(counts[k] for k in far), text
    )


def undecided(counts: Sequence[int], odds: Odds) -> list[Finding]:
    """Why the runs do not bear a verdict: at most one reason, of the worst number."""
    width = odds.high - odds.low
    k = int(np.argmax(width))
    if width[k] <= MAX_INTERVAL:
        return []
    ends = {"low": _two(odds.low[k]), "high": _two(odds.high[k])}
    return [Finding("probability-uncertain", {"facets": facets(counts[k]), **ends})]


def facets(n: int) -> str:
    """1 facet, 2 facets."""
    return f"{n} facet" if n == 1 else f"{n} facets"


def _two(probability: float) -> str:
    """Two decimals, but never 1 or 0 of what is neither."""
    if 0.995 <= probability < 1.0:
        return "> 0.99"
    return "< 0.01" if 0.0 < probability < 0.005 else f"{probability:.2f}"
