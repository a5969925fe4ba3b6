"""Scores and tables of the fault benchmarks, without a fit."""

from __future__ import annotations

import importlib
from argparse import Namespace
from pathlib import Path

import numpy as np
import pytest

from benchmarks import _scores as scores

ROOT = Path(__file__).parents[3]


@pytest.fixture
def cases(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    return importlib.import_module("_cases")


def body(rng: np.random.Generator) -> scores.Truth:
    normals = np.array([[1.0, 0, 0], [-0.9, 0.4, 0.1], [0, 0.6, 0.8]])
    return scores.Truth(rng.normal(size=3) * 0.03, normals, np.array([1.0, 2.0, 4.0]))


def draws(truth: scores.Truth, rng: np.random.Generator, off: float) -> scores.Draws:
    """2000 draws with 2 % errors about a centre that is off by so many of them."""

    def about(x: np.ndarray) -> np.ndarray:
        return x + 0.02 * np.abs(x).max() * (off + rng.normal(size=(2000, *x.shape)))

    order = [2, 0, 1]
    return scores.Draws(about(truth.omega), about(truth.normals[order]), about(truth.areas[order]))


def test_facets_are_matched_before_they_are_scored():
    rng = np.random.default_rng(0)
    truth = body(rng)
    result = draws(truth, rng, 0.0)
    assert scores.matched(result, truth)[0].tolist() == [1, 2, 0]
    inside = scores.body_inside([result], truth)
    assert len(inside) == 12  # rate, pole, and three quantities of each facet
    assert all(inside.values())
    wrong = scores.body_inside([draws(truth, rng, 3.0)], truth)
    assert not any(wrong[f"area {i}"] for i in range(3))
    assert not wrong["rate"]


def test_the_nearest_of_several_solutions_is_scored():
    rng = np.random.default_rng(1)
    truth = body(rng)
    far = draws(truth._replace(omega=-truth.omega), rng, 0.0)
    assert all(scores.body_inside([far, draws(truth, rng, 0.0)], truth).values())


def test_angles_at_the_seam():
    rng = np.random.default_rng(2)
    azimuth = np.pi + 0.1 * rng.normal(size=1000)
    assert scores.angle_within(np.angle(np.exp(1j * azimuth)), np.pi - 0.05)
    assert scores.angle_within(azimuth, -np.pi + 0.05)
    assert not scores.angle_within(azimuth, 0.0)


def test_errors_of_shares():
    """Independent trials: √(p (1 − p)/n). Fits that are all inside or all outside: more."""
    assert scores.share(50, 100).se == pytest.approx(0.05, rel=0.01)
    assert scores.share(20, 20).se > 0.03
    assert str(scores.share(0, 0)) == "–"
    apart = scores.pooled(np.array([10, 0] * 20), np.full(40, 10))
    assert apart.value == 0.5
    assert apart.se == pytest.approx(0.5 / np.sqrt(39), rel=0.01)


def outcome(cases, trusted: bool, held: int):
    inside = {f"q{i}": i < held for i in range(4)}
    return cases.Outcome(trusted, inside, [] if trusted else ["bad"], 1, 10.0, 9.0, "one site")


def test_a_run_is_resumed(cases, tmp_path, capsys):
    """Cases that are done are not repeated, and a row that was cut off is."""
    cells = [cases.Cell("none", 0.0), cases.Cell("clock", 0.5)]
    ran = []

    def case(cell, seed, _):
        ran.append((str(cell), seed))
        if seed == 1 and cell.size:
            raise ValueError("no orbit")
        return outcome(cases, not cell.size, 4 if not cell.size else 2)

    given = Namespace(out=tmp_path, cells=cells, seeds=2, first_seed=0, table_only=False)
    rows = cases.run(given, case, "quantities")
    assert ran == [("none", 0), ("clock:0.5", 0), ("none", 1), ("clock:0.5", 1)]
    said = capsys.readouterr().out
    assert f"| none | 2 | {scores.share(2, 2)} | {scores.share(8, 8)} (8 of 8) | – | 0 |" in said
    assert f"| clock:0.5 | 2 | {scores.share(0, 2)} | – | {scores.share(2, 4)} | 0 |" in said
    path = tmp_path / "cases.csv"
    text = path.read_text()
    assert "ValueError: no orbit" in text
    assert "q2;q3" in text
    assert cases.run(given, case, "quantities") == rows
    assert len(ran) == 4
    path.write_text("\n".join([*text.splitlines()[:-1], "clock,0.5,1,0"]) + "\n")
    cases.run(given, case, "quantities")
    assert ran[4:] == [("clock:0.5", 1)]


def test_cells_are_chosen_by_name_or_size(cases, monkeypatch, tmp_path):
    cells = [cases.Cell("none", 0.0), cases.Cell("clock", 0.1), cases.Cell("clock", 0.5)]

    def chosen(text: str) -> list[str]:
        monkeypatch.setattr("sys.argv", ["faults.py", "-o", str(tmp_path), "--cells", text])
        return [str(c) for c in cases.arguments("doc", cells, 20).cells]

    assert chosen("clock") == ["clock:0.1", "clock:0.5"]
    assert chosen("clock:0.5,none") == ["none", "clock:0.5"]
    assert len(chosen("all")) == 3
    with pytest.raises(SystemExit):
        chosen("clock:0.7")
