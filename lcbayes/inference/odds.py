"""Probabilities of the numbers of facets from their evidences, and a one-sentence summary."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.reasons import Finding
from lcbayes.core.text import join_words

Floats = NDArray[np.float64]

DRAWS = 20_000  # Monte Carlo draws of the evidences
EXCLUDED_PROBABILITY = 0.05  # a number is excluded if its probability, including error, is below
MIN_ODDS = 2.0  # least ratio to the next probability at which one number is preferred
MAX_INTERVAL = 0.5  # a wider interval of a probability is uninformative


class Odds(NamedTuple):
    """Posterior probability of each number of facets, (K,) each."""

    probability: Floats
    low: Floats  # 5 and 95 % quantiles, from the errors of the evidences
    high: Floats


def moderated(se: Floats) -> Floats:
    """Errors (K,) estimated from a few runs, with variances shrunk halfway to the common variance.

    Two or four runs can agree by chance, and the error is then far too small. The scatter between
    runs is similar for neighbouring numbers of facets. The variance of each number is therefore the
    mean of its own variance and the common one, with twice the degrees of freedom.

    References
    ----------
    Smyth 2004, Stat. Appl. Genet. Mol. Biol. 3, 3 (moderated t; here with equal weights).
    """
    return np.sqrt(0.5 * (se**2 + np.mean(se**2)))


def probabilities(log_evidence: Floats, se: Floats, n_runs: int, seed: int = 0) -> Odds:
    """p(N | y) ∝ Z_N under the same prior probability for each N.

    Facets are exchangeable, and the prior does not depend on their order. Z_N is an integral over
    all N! orders of every body, with a prior that integrates to one over all of them. Each body has
    N! peaks, each with 1/N! of the prior density, and the two factors cancel. Z_N is therefore
    already the evidence: dividing it by N! would correct for the orders twice.

    The error of each ln Z_N is itself estimated from ``n_runs`` runs. ln Z_N is therefore Student-t
    distributed with 2 (n_runs − 1) degrees of freedom (`moderated`). The interval is that of the
    probabilities when each ln Z_N is drawn from its own distribution.

    Parameters
    ----------
    log_evidence, se : (K,)
        Log evidences under priors that integrate to one, and their errors from `moderated`.
    """
    rng = np.random.default_rng(seed)
    error = rng.standard_t(2 * (n_runs - 1), (DRAWS, len(se))) * se
    low, high = np.quantile(shares(log_evidence + error), [0.05, 0.95], axis=0)
    return Odds(shares(log_evidence), low, high)


def shares(log_evidence: Floats) -> Floats:
    """p(N | y) ∝ Z_N of the last axis."""
    share = np.exp(log_evidence - log_evidence.max(axis=-1, keepdims=True))
    return share / share.sum(axis=-1, keepdims=True)


def evidence_change(
    log_areas: Floats, log_mean: float, log_sd: float, other: float
) -> tuple[float, float]:
    """Change of ln Z when the mean of the normal prior on ln α of each facet becomes ``other``.

    Z′/Z = E[p′(α)/p(α)] over draws (S, N) of ln α from the posterior under the prior p; the second
    number is the effective number of draws in this mean. Factors of the prior that do not depend on
    the areas cancel.
    """
    shift = (other - log_mean) / log_sd**2
    ratio = np.sum(shift * (log_areas - 0.5 * (log_mean + other)), axis=1)
    top = float(np.max(ratio))
    weight = np.exp(ratio - top)
    return top + float(np.log(np.mean(weight))), float(weight.sum() ** 2 / np.sum(weight**2))


class Verdict[Row: (int, str)](NamedTuple):
    """Conclusion from the probabilities of numbers of facets or of kinds of body."""

    best: Row
    rivals: list[Row]  # cannot be distinguished from the best
    possible: list[Row]  # less probable, but not excluded
    sentence: str


def verdict(counts: Sequence[int], odds: Odds) -> Verdict[int]:
    """The number of facets, or the numbers that the data cannot distinguish.

    A number is excluded if its probability, including its error, is below 0.05. The best number is
    preferred if it is at least twice as probable as the next and their intervals do not overlap.
    """
    top, near, far = _ranked(odds)
    left = [*near, *far]

    chance = _two(odds.probability[top])
    if near:
        alike = sorted([top, *near], key=lambda k: counts[k])
        *others, last = [str(counts[k]) for k in alike]
        chances = ", ".join(_two(odds.probability[k]) for k in alike)
        text = f"the data cannot tell {join_words(others)} from {last} facets ({chances})"
        if far:
            text += f", and {_named(counts, odds, far)} cannot be excluded"
    else:
        verb = "is" if counts[top] == 1 else "are"
        text = f"{facets(counts[top])} {verb} most probable ({chance}); "
        text += (
            f"{_named(counts, odds, far)} cannot be excluded"
            if far
            else "no other number tried is likely"
        )
    most = max(counts)
    if counts[top] == most or any(counts[k] == most for k in left):
        text += f"; more than {most} were not tried"
    return Verdict(
        counts[top], sorted(counts[k] for k in near), sorted(counts[k] for k in far), text
    )


def _ranked(odds: Odds) -> tuple[int, list[int], list[int]]:
    """The most probable row, those that cannot be distinguished from it, and those that are less
    probable but not excluded."""
    order = [int(k) for k in np.argsort(-odds.probability, kind="stable")]
    top = order[0]
    left = [k for k in order[1:] if odds.high[k] > EXCLUDED_PROBABILITY]
    near = [
        k
        for k in left
        if MIN_ODDS * odds.probability[k] > odds.probability[top] or odds.high[k] > odds.low[top]
    ]
    return top, near, [k for k in left if k not in near]


def _named(rows: Sequence[int | str], odds: Odds, ks: Sequence[int]) -> str:
    """Some rows with their probabilities."""
    return join_words([f"{rows[k]} ({_two(odds.probability[k])})" for k in ks])


def verdict_of_bodies(names: Sequence[str], odds: Odds) -> Verdict[str]:
    """`verdict` for kinds of body."""
    top, near, far = _ranked(odds)

    if near:
        *others, last = (names[k] for k in sorted([top, *near]))
        chances = ", ".join(_two(odds.probability[k]) for k in sorted([top, *near]))
        text = f"the data cannot distinguish {join_words(others)} from {last} ({chances})"
        text += f", and {_named(names, odds, far)} cannot be excluded" if far else ""
    else:
        text = f"{names[top]} is most probable ({_two(odds.probability[top])}); "
        text += (
            f"{_named(names, odds, far)} cannot be excluded"
            if far
            else "no other body tried is likely"
        )
    return Verdict(names[top], [names[k] for k in near], [names[k] for k in far], text)


def undecided(names: Sequence[str], odds: Odds) -> list[Finding]:
    """Reason why the runs do not allow a conclusion: at most one, for the least certain row."""
    width = odds.high - odds.low
    k = int(np.argmax(width))
    if width[k] <= MAX_INTERVAL:
        return []
    ends = {"low": _two(odds.low[k]), "high": _two(odds.high[k])}
    return [Finding("probability-uncertain", {"facets": names[k], **ends})]


def facets(n: int) -> str:
    """1 facet, 2 facets."""
    return f"{n} facet" if n == 1 else f"{n} facets"


def _two(probability: float) -> str:
    """Two decimals, but never 1 or 0 for a probability strictly between them."""
    if 0.995 <= probability < 1.0:
        return "> 0.99"
    return "< 0.01" if 0.0 < probability < 0.005 else f"{probability:.2f}"
