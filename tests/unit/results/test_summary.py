"""What a fit is told to be worth."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from lcbayes.inference.fit import Mode
from lcbayes.inference.goodness_of_fit import Misfit
from lcbayes.inference.solutions import Solution
from lcbayes.inference.tumbling_search import Repeats
from lcbayes.results import summary
from lcbayes.results.reasons import reason as sentence
from lcbayes.results.reasons import searched
from lcbayes.samplers.bridge import LogEvidence


def test_parameters_of_independent_draws():
    rng = np.random.default_rng(1)
    draws = {
        "albedo_area": rng.normal(5.0, 0.1, (4, 500, 2)),
        "omega": rng.standard_normal((4, 500, 3)),
        "phi": np.mod(rng.normal(0.0, 0.1, (4, 500, 2)), 2 * np.pi),
        "normals": np.ones((4, 500, 2, 3)),
        "log_albedo_area": rng.standard_normal((4, 500, 2)),
    }
    table = summary.parameters(draws)
    assert set(table) == {
        "albedo_area[0]",
        "albedo_area[1]",
        "omega_x_rad_s",
        "omega_y_rad_s",
        "omega_z_rad_s",
        "phi[0]",
        "phi[1]",
    }
    row = table["albedo_area[0]"]
    np.testing.assert_allclose(row["q05"], np.quantile(draws["albedo_area"][..., 0], 0.05))
    np.testing.assert_allclose(row["sd"], draws["albedo_area"][..., 0].std(ddof=1))
    assert row["rhat"] < 1.01
    assert row["ess_bulk"] > 1500
    assert table["phi[0]"]["sd"] < 0.12  # across the seam it would be three


ROW = {
    "max_rhat": 1.0,
    "min_ess_bulk": 900.0,
    "min_ess_tail": 900.0,
    "divergences": 0,
    "parameters": {},
}
FIT = Misfit(100.0, 100.0, "gaussian")


def reasons(n_modes=1, hits=5, weight=1.0, se=0.1, fit=FIT, searched=None, **row) -> list[str]:
    stats = {"diverging": np.zeros((4, 500), bool)}
    modes = [
        Mode(
            Solution(np.zeros(2), 0.0, 0.0, 1.0, hits),
            np.zeros((4, 500, 2)),
            stats,
            LogEvidence(0.0, se),
            1.0 if i == 0 else weight,
        )
        for i in range(n_modes)
    ]
    posterior = SimpleNamespace(modes=modes, n_starts=50, reasons=[], searched=searched)
    entries = [dict(ROW)] * (n_modes - 1) + [ROW | row]
    result = summary._findings(posterior, entries, fit)  # type: ignore[arg-type]
    return [sentence(one).text for one in result]


def test_good_chains_give_no_reason():
    assert reasons() == []
    assert reasons(2, weight=0.5) == []


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"max_rhat": 1.02}, "chains disagree"),
        ({"max_rhat": float("nan")}, "chains disagree"),
        ({"min_ess_bulk": 399.0}, "only 399 independent ones (bulk"),
        ({"min_ess_tail": 20.0}, "only 20 independent ones (tail"),
        ({"min_ess_bulk": float("nan")}, "independent ones"),
        ({"divergences": 11}, "11 of 2000 trajectories diverged"),
        ({"hits": 1}, "only one of 50 starts"),
        ({"fit": Misfit(300.0, 100.0, "gaussian")}, "does not explain the data"),
        ({"n_modes": 2, "weight": 0.3, "se": 0.9}, "its weight is uncertain"),
        ({"n_modes": 2, "weight": 0.3, "max_rhat": 1.5}, "solution 2: the chains disagree"),
    ],
)
def test_each_fault_is_a_reason(change, says):
    result = reasons(**change)
    assert any(says in reason for reason in result)
    assert all("\n" not in reason for reason in result)


@pytest.mark.parametrize(
    ("rhat", "ess", "agrees"),
    [(1.004, 1300.0, True), (1.02, 1300.0, False), (1.004, 300.0, False), (np.nan, 900.0, False)],
)
def test_a_rotation_on_which_chains_agree_is_named(rhat, ess, agrees):
    row = {"rhat": rhat, "ess_bulk": ess, "ess_tail": 900.0}
    good = {"rhat": 1.0, "ess_bulk": 900.0, "ess_tail": 900.0}
    result = {"omega_x_rad_s": good, "omega_y_rad_s": row, "phi[0]": {**good, "rhat": 1.8}}
    (text,) = reasons(max_rhat=1.8, parameters=result)
    assert ("only its rate and axis of rotation agree (R-hat 1.004)" in text) == agrees
    # of several solutions, one sentence joins all, whose rotations may differ in this
    (text,) = reasons(2, weight=0.5, max_rhat=1.8, parameters=result)
    assert "axis of rotation agree" not in text


def test_a_solution_without_weight_does_not_spoil_the_others():
    assert reasons(2, weight=1e-4, max_rhat=2.0) == []


def test_a_good_fit_is_no_reason():
    assert reasons(fit=Misfit(None, 10.0, "gaussian")) == []
    assert reasons(fit=Misfit(150.0, 100.0, "mixture")) == []


@pytest.mark.parametrize("agree", [1, 2])
def test_independent_searches_must_agree(agree):
    result = reasons(searched=Repeats(6, agree, 1, 9000), hits=1)
    assert [("only one of 6 independent searches" in text) for text in result] == [True] * (
        2 - agree
    )


def test_several_motions_that_explain_the_data_are_named():
    (text,) = reasons(searched=Repeats(4, 1, 3, 9000), hits=1)
    assert "4 independent searches ended at 3 motions that explain them nearly" in text


def test_the_text_says_how_thorough_a_search_of_a_tumbler_was():
    (line,) = searched({"searches": 3, "agree": 2, "starts": 4500})
    assert line.startswith(
        "2 of 3 independent searches ended at the best motion, from 4,500 starts"
    )
