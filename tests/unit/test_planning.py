"""The planner against Gaussian conditioning written out, and against all sets of visits."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from lcbayes.observability import planning


def conditioned(measured, targets, visits):
    """Covariance of the targets after those visits, from the joint covariance; noise is 1."""
    a = measured[list(visits)].reshape(-1, measured.shape[-1])
    k = a @ a.T + np.eye(len(a))
    return targets @ targets.T - targets @ a.T @ np.linalg.solve(k, a @ targets.T)


def case(seed, candidates=12, rows=2, size=5, wanted=2):
    rng = np.random.default_rng(seed)
    measured = rng.standard_normal((candidates, rows, size)) * rng.lognormal(
        0.0, 1.0, (candidates, 1, 1)
    )
    measured[0, 1:] = 0.0  # a visit with fewer measurements
    return measured, rng.standard_normal((wanted, size))


@pytest.mark.parametrize("criterion", planning.CRITERIA)
def test_gains_and_variances_are_those_of_gaussian_conditioning(criterion):
    measured, targets = case(1)
    found = planning.best(measured, targets, 4, criterion)
    assert len(set(found.visits.tolist())) == 4
    before = targets @ targets.T
    assert found.sd[0] == pytest.approx(np.sqrt(np.trace(before) / 2))
    for i in range(4):
        after = conditioned(measured, targets, found.visits[: i + 1])
        assert found.sd[i + 1] == pytest.approx(np.sqrt(np.trace(after) / 2), rel=1e-9)
        told = 0.5 * np.log(np.linalg.det(before) / np.linalg.det(after))
        assert found.gain[i] == pytest.approx(told, rel=1e-8)
        before = after
    alone = [
        0.5 * np.log(np.linalg.det(targets @ targets.T) / np.linalg.det(
            conditioned(measured, targets, [g])))
        for g in range(len(measured))
    ]  # fmt: skip
    np.testing.assert_allclose(found.first_gain, alone, rtol=1e-8)


@pytest.mark.parametrize("criterion", planning.CRITERIA)
def test_no_exchange_of_one_visit_makes_a_schedule_better(criterion):
    """And the order is the greedy one among the members."""
    measured, targets = case(2)

    def value(visits):
        v = conditioned(measured, targets, visits)
        return np.trace(v) if criterion == "A" else np.linalg.slogdet(v)[1]

    found = planning.best(measured, targets, 4, criterion).visits.tolist()
    for i in range(4):
        kept = found[:i] + found[i + 1 :]
        others = set(range(len(measured))) - set(found)
        assert all(value([*kept, g]) >= value(found) - 1e-12 for g in others)
        assert value(found[: i + 1]) == pytest.approx(
            min(value([*found[:i], g]) for g in found[i:])
        )


def test_schedules_are_near_the_best_sets_of_all():
    """Of all 220 sets of three: within 2 % of the information and 5 % of the variance."""
    for seed in range(5):
        measured, targets = case(10 + seed)
        sets = list(combinations(range(len(measured)), 3))
        after = np.array([conditioned(measured, targets, s) for s in sets])
        start = np.linalg.slogdet(targets @ targets.T)[1]
        most = start - np.linalg.slogdet(after)[1].min()
        assert 2.0 * planning.best(measured, targets, 3, "D").gain.sum() > 0.98 * most
        least = np.sqrt(np.trace(after, axis1=1, axis2=2).min() / len(targets))
        assert planning.best(measured, targets, 3, "A").sd[-1] < 1.05 * least


def test_regression_over_draws_gives_the_linear_model_and_counts_the_rest_as_noise():
    """Measurements and targets linear in five parameters, and a part that no line describes."""
    rng = np.random.default_rng(4)
    measured, targets = case(5)
    a = measured.reshape(-1, 5)
    draws = rng.standard_normal((400, 5))
    u = (draws - draws.mean(axis=0)) / np.sqrt(399)
    found = planning.linearised(a @ u.T, targets @ u.T, draws * [1e-3, 1.0, 50.0, 1.0, 1.0])
    joint = np.vstack([a, targets]) @ (u.T @ u) @ np.vstack([a, targets]).T
    np.testing.assert_allclose(np.vstack(found) @ np.vstack(found).T, joint, rtol=1e-9, atol=1e-9)
    # a bend of variance 8 beside a noise of 1: three times the error
    q, _ = np.linalg.qr(np.column_stack([np.ones(400), u, rng.standard_normal((400, 2))]))
    bent, moved = np.sqrt(8.0) * q[:, -1], 0.3 * q[:, -2]
    some, wanted = planning.linearised(a @ u.T + bent, targets @ u.T + moved, draws)
    np.testing.assert_allclose(some @ some.T, joint[:-2, :-2] / 9.0, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(wanted @ wanted.T, joint[-2:, -2:] + 0.09, rtol=1e-9)
    np.testing.assert_allclose(wanted @ some.T, joint[-2:, :-2] / 3.0, rtol=1e-9, atol=1e-9)


def test_a_schedule_given_is_accounted_for_in_its_order():
    measured, targets = case(3)
    visits = planning.even(len(measured), 4)
    assert visits.tolist() == [1, 4, 7, 10]
    found = planning.given(measured, targets, visits)
    assert found.visits.tolist() == visits.tolist()
    after = conditioned(measured, targets, visits)
    assert found.sd[-1] == pytest.approx(np.sqrt(np.trace(after) / 2), rel=1e-9)
    assert found.sd[-1] >= planning.best(measured, targets, 4).sd[-1]


def test_unknown_criterion():
    with pytest.raises(ValueError, match="unknown criterion 'E'; available: A, D"):
        planning.best(*case(1), 1, "E")
