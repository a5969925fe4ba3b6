"""From evidences to probabilities and a sentence, on numbers whose answer is known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from lcbayes.inference.odds import (
    Odds,
    moderated,
    probabilities,
    undecided,
    verdict,
    verdict_of_bodies,
)
from lcbayes.results.reasons import reason as sentence
from tests.helpers.false_alarms import EACH


def test_probabilities_are_shares_of_the_evidence():
    result = probabilities(np.log([1.0, 3.0, 6.0]) - 4000.0, np.zeros(3), 4)
    np.testing.assert_allclose(result.probability, [0.1, 0.3, 0.6])
    np.testing.assert_allclose(result.low, result.probability)
    np.testing.assert_allclose(result.high, result.probability)


def test_the_interval_is_that_of_the_runs_errors():
    """One evidence known, one of error 0.3 from 5 runs: ln odds are Student-t with 8 degrees."""
    result = probabilities(np.array([0.0, 0.5]), np.array([0.0, 0.3]), 5)
    t = 0.3 * stats.t.ppf(0.95, 8)
    exact = 1.0 / (1.0 + np.exp(-0.5 + np.array([t, -t])))
    np.testing.assert_allclose([result.low[1], result.high[1]], exact, atol=0.005)
    np.testing.assert_allclose(result.low[0], 1.0 - result.high[1], atol=1e-9)


def test_few_runs_tell_less():
    width = [np.ptp(probabilities(np.zeros(2), np.full(2, 0.2), n)[1:]) for n in (2, 4, 16)]
    assert width[0] > 1.3 * width[1] > 1.3 * width[2]


def test_runs_that_agree_by_chance_do_not_decide():
    np.testing.assert_allclose(moderated(np.array([0.0, 0.4])), np.array([0.2, np.sqrt(0.12)]))
    np.testing.assert_allclose(moderated(np.full(3, 0.4)), 0.4)


@pytest.mark.statistical(false_alarm=EACH)
@pytest.mark.parametrize(("sds", "least"), [((0.5, 0.5, 0.5), 0.9), ((0.3, 0.5, 0.7), 0.85)])
def test_errors_of_two_runs_hold_the_truth(sds, least):
    """90 % of the time or more; where the numbers differ by more than two in what runs differ by,
    so on average, and 85 % for the widest. And narrower than each alone, with one degree.

    Of 40,000 trials; what holds lies 7 standard errors and more from these bounds.
    """
    rng = np.random.default_rng(1)
    runs = rng.normal(size=(40_000, 3, 2)) * np.array(sds)[:, None]
    error, alone = runs.mean(axis=2), runs.std(axis=2, ddof=1) / np.sqrt(2)
    se = np.array([moderated(one) for one in alone])
    held = np.mean(np.abs(error) < stats.t.ppf(0.95, 2) * se, axis=0)
    assert held.mean() > 0.9
    assert held.min() > least
    assert stats.t.ppf(0.95, 2) * np.median(se) < 0.75 * stats.t.ppf(0.95, 1) * np.median(alone)


def odds(*p, error=0.02) -> Odds:
    p = np.array(p)
    return Odds(p, np.maximum(p - error, 0.0), np.minimum(p + error, 1.0))


NONE = "no other number tried is likely"
SENTENCES = [
    (
        (1, 2, 3, 4, 5),
        odds(0, 0.01, 0.71, 0.27, 0.01),
        "3 facets are most probable (0.71); 4 (0.27) cannot be excluded",
    ),
    ((2, 3, 4, 5), odds(0, 0.53, 0.46, 0.01), "the data cannot tell 3 from 4 facets (0.53, 0.46)"),
    (
        (3, 4, 5, 6),
        odds(0.48, 0.41, 0.1, 0.01),
        "the data cannot tell 3 from 4 facets (0.48, 0.41), and 5 (0.10) cannot be excluded",
    ),
    (
        (3, 4, 5, 6),
        odds(0.3, 0.36, 0.33, 0.01),
        "the data cannot tell 3 and 4 from 5 facets (0.30, 0.36, 0.33)",
    ),
    ((1, 2, 3), odds(0.999, 0.001, 0.0), f"1 facet is most probable (> 0.99); {NONE}"),
    ((1, 2, 3), odds(0.98, 0.02, 0.0), f"1 facet is most probable (0.98); {NONE}"),
    (
        (1, 2, 3),
        odds(0.0, 0.02, 0.98),
        f"3 facets are most probable (0.98); {NONE}; more than 3 were not tried",
    ),
    (
        (1, 2, 3),
        odds(0.0, 0.8, 0.2),
        "2 facets are most probable (0.80); 3 (0.20) cannot be excluded; "
        "more than 3 were not tried",
    ),
    (
        (1, 2, 3, 4),
        odds(0.14, 0.7, 0.16, 0.0),
        "2 facets are most probable (0.70); 3 (0.16) and 1 (0.14) cannot be excluded",
    ),
    ((2, 4, 9), odds(0.5, 0.5, 0.0), "the data cannot tell 2 from 4 facets (0.50, 0.50)"),
]


@pytest.mark.parametrize(("counts", "given", "says"), SENTENCES, ids=lambda x: str(x)[:30])
def test_the_sentence(counts, given, says):
    assert verdict(counts, given).sentence == says


def test_the_runs_errors_enter_the_verdict():
    """0.68 against 0.32 stands out when known to 0.02, not when known to 0.2; and 0.02 known to
    0.06 is not excluded."""
    counts = (1, 2, 3)
    sure = verdict(counts, odds(0.68, 0.32, 0.0))
    assert (sure.best, sure.rivals, sure.possible) == (1, [], [2])
    unsure = verdict(counts, odds(0.68, 0.32, 0.0, error=0.2))
    assert unsure.rivals == [2]
    assert 3 in unsure.possible
    assert verdict(counts, odds(0.98, 0.02, 0.0, error=0.06)).possible == [2, 3]


def test_runs_that_disagree_are_reported():
    assert undecided(("1 facet", "2 facets"), odds(0.6, 0.4, error=0.2)) == []
    (result,) = undecided(("1 facet", "2 facets"), odds(0.6, 0.4, error=0.3))
    reason = sentence(result).text
    assert "the probability of 1 facet may be anything from 0.30 to 0.90" in reason
    assert "--num-particles" in reason


BODIES = ("rocket-stage", "plate", "facets:3")


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (odds(0.0, 1.0, 0.0), "plate is most probable (1.00); no other body tried is likely"),
        (odds(0.9, 0.1, 0.0), "rocket-stage is most probable (0.90); plate (0.10) cannot be "),
        (
            odds(0.45, 0.1, 0.45),
            "the data cannot distinguish rocket-stage from facets:3 (0.45, 0.45), and plate (0.10)",
        ),
    ],
)
def test_the_sentence_about_bodies(given, says):
    result = verdict_of_bodies(BODIES, given)
    assert result.sentence.startswith(says)
    assert result.best == BODIES[int(np.argmax(given.probability))]
