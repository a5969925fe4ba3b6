"""The spins of all plausible solutions, and when the data do not determine the spin."""

from __future__ import annotations

import numpy as np
import pytest

from lcbayes.core.jax_setup import jnp
from lcbayes.inference.solutions import Solution
from lcbayes.inference.spin_solutions import (
    SpinSolution,
    largest_share,
    spin_solutions,
    undetermined,
)
from lcbayes.modelling.problem import compiled
from lcbayes.results.reasons import other_spins, reason
from tests.helpers import small_curves


def spin(period_s=30.0, axis=(0.0, 0.0, 1.0), share=0.5, *, sampled=True) -> SpinSolution:
    omega = 2 * np.pi / period_s * np.array(axis) / np.linalg.norm(axis)
    return SpinSolution(period_s, omega.tolist(), share, sampled)


def test_spins_and_shares_of_solutions():
    problem, data = small_curves.posterior(
        small_curves.curve(8, spinning=True), n_facets=1, omega_sd=0.1
    )
    rng = np.random.default_rng(0)
    z = rng.standard_normal((4, problem.dim))
    log_z = np.log([0.6, 0.3, 0.095, 0.005])
    every = [Solution(a, 0.0, float(b), 1.0, 1) for a, b in zip(z, log_z, strict=True)]
    result = spin_solutions(problem, data, every[1:2], [every[0], *every[2:]])
    np.testing.assert_allclose(
        [s.share for s in result], [0.6, 0.3, 0.095]
    )  # without that of 0.5 %
    assert [s.sampled for s in result] == [False, True, False]
    for s, row in zip(result, z, strict=False):
        # ω/omega_sd is sampled in its components
        omega = 0.1 * row[problem.rows(["omega_unit"])]
        np.testing.assert_allclose(s.omega_rad_s, omega)
        assert s.period_s == pytest.approx(2 * np.pi / np.linalg.norm(omega))
        sites = compiled(problem.constrain)(jnp.asarray(row), data)
        np.testing.assert_allclose(s.omega_rad_s, sites["omega"])


def test_a_poor_evidence_keeps_a_spin_among_the_plausible_ones():
    """A share of 1e-4 may be 4 % if ln evidence is uncertain by 3: e⁶ times as large."""
    problem, data = small_curves.posterior(
        small_curves.curve(8, spinning=True), n_facets=1, omega_sd=0.1
    )
    z = np.random.default_rng(1).standard_normal((3, problem.dim))
    log_z = np.log([1.0, 1e-4, 1e-5])
    best, *rest = [Solution(a, 0.0, float(b), 1.0, 1) for a, b in zip(z, log_z, strict=True)]
    assert len(spin_solutions(problem, data, [best], rest)) == 1
    assert len(spin_solutions(problem, data, [best], rest, 3.0)) == 2
    assert largest_share(1e-4, 3.0) == pytest.approx(1e-4 * 403.43, rel=1e-4)
    assert largest_share(0.5, 3.0) == 1.0
    assert largest_share(1e-9, 1e11) == 1.0  # a bridge that fails
    assert largest_share(1e-9, np.inf) == 1.0
    assert largest_share(0.0, np.inf) == 0.0


def test_bodies_without_a_constant_rotation_have_no_spins():
    for kind in ("none", "torque-free"):
        problem, data = small_curves.posterior(small_curves.curve(8), n_facets=1, spin=kind)
        solution = Solution(np.ones(problem.dim), 0.0, 0.0, 1.0, 1)
        assert spin_solutions(problem, data, [solution], []) == []


@pytest.mark.parametrize(
    ("spins", "left"),
    [
        ([spin(), spin(31.0)], 0.0),  # every solution was sampled
        ([spin()], 0.3),
        ([spin(), spin(30.01, sampled=False)], 0.3),  # one spin, and two bodies
        ([spin(), spin(axis=(0.0, 0.1, -1.0), sampled=False)], 0.3),  # opposite axes
    ],
)
def test_a_spin_is_determined(spins, left):
    assert undetermined(spins, left) == []


@pytest.mark.parametrize(
    ("other", "axes"),
    [
        (spin(30.2, sampled=False), "s and one axis,"),
        (spin(axis=(0.0, 0.3, 1.0), sampled=False), "s and axes up to 17 deg apart,"),  # arctan 0.3
    ],
)
def test_several_spins_of_which_one_was_not_sampled(other, axes):
    (result,) = undetermined([spin(), other], 0.65)
    text = reason(result).text
    assert text.startswith("the data do not determine the spin: 2 solutions explain them")
    assert f"from 30 to {max(30.0, other.period_s):.5g} s" in text
    assert axes in text
    assert "those not sampled may hold 65 % of the posterior" in text


def test_the_text_lists_the_spins_only_if_one_was_not_sampled():
    rows = [s._asdict() for s in (spin(), spin(31.5, (1.0, 0.0, 0.0), 0.25, sampled=False))]
    assert other_spins(rows[:1]) == other_spins([]) == []
    first, second, third = other_spins(rows)
    assert "share of the posterior" in first
    assert second == "   50 %  period 30 s, axis   0.0, +90.0 deg"
    assert third == "   25 %  period 31.5 s, axis   0.0,  +0.0 deg, not sampled"
    assert other_spins(rows[1:] * 40)[-1] == "  … and 28 more in summary.json"
