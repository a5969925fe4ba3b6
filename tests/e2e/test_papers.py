"""The scripts that draw the paper's figures say what they do and write what they promise."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from lcbayes.core.jax_setup import jnp
from tests.helpers import paper_scripts

burn_in, six_facets = map(paper_scripts.load, ("burn_in", "six_facets"))

ROOT = Path(__file__).resolve().parents[2]
SCRIPTS = (
    "figure2",
    "figure3",
    "figure4",
    "figure5",
    "figure6",
    "figure7",
    "figure8",
    "bias",
    "hall_figure2",
    "hall_figure3",
)
SMALL_BURN_IN = ("--facets", "3", "--chains", "2", "--transitions", "20")


def script(name: str, *args: str) -> str:
    path = ROOT / "analysis" / "papers" / f"{name}.py"
    done = subprocess.run(
        [sys.executable, str(path), *args], capture_output=True, text=True, check=True, cwd=ROOT
    )
    return done.stdout


@pytest.mark.parametrize("name", SCRIPTS)
def test_help_has_an_example(name, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", [f"analysis/papers/{name}.py", "--help"])
    with pytest.raises(SystemExit) as end:
        paper_scripts.load(name).main()
    assert end.value.code == 0
    output = capsys.readouterr().out
    assert f"example: python analysis/papers/{name}.py -o figures --seed 1" in output
    assert "--seed" in output


@pytest.mark.parametrize(
    ("name", "options"),
    [
        pytest.param("figure2", (), marks=pytest.mark.slow),
        ("hall_figure3", ("--draws", "3000")),
        pytest.param("hall_figure2", (), marks=pytest.mark.slow),
        pytest.param("figure3", ("--draws", "80"), marks=pytest.mark.slow),
        pytest.param("figure5", SMALL_BURN_IN, marks=pytest.mark.slow),
        pytest.param("figure6", ("--draws", "400"), marks=pytest.mark.slow),
        pytest.param("hinks", (), marks=pytest.mark.slow),
        pytest.param("wang", (), marks=pytest.mark.slow),
    ],
)
def test_figures_are_written(name, options, tmp_path):
    output = script(name, "-o", str(tmp_path), "--seed", "2", *options)
    assert str(tmp_path / f"{name}.png") in output
    assert (tmp_path / f"{name}.png").stat().st_size > 20_000
    assert (tmp_path / f"{name}.svg").read_text().startswith("<?xml")


def test_the_papers_pass_leaves_two_sides_of_the_cube_dark():
    """Eq. (31) lights neither of ±z of eq. (32): no flux of theirs, whatever their area."""
    one, three = (six_facets.experiment(1, n) for n in (1, 3))
    poles = np.abs(one.normals[:, 2]) > 0.5
    assert np.sum(poles) == 2
    assert np.all(np.abs(one.best_seen()[poles]) < 1e-12)
    assert np.all(one.best_seen()[~poles] > 0.4)
    assert np.all(three.best_seen() > 0.4)


def test_burnt_in_chains_are_thinned_out_by_the_sparse_path():
    """Points of six facets and four slivers, as if a chain had ended there: six remain."""
    data = six_facets.experiment(1).data
    problem, _ = six_facets.sparse_problem(data, 10, 60.0)
    rng = np.random.default_rng(0)
    sides = np.concatenate([np.eye(3), -np.eye(3), np.eye(3), np.array([[0.6, 0.8, 0.0]])])
    areas = np.array([10.0] * 6 + [0.01] * 4)
    z = np.asarray(
        problem.ravel({"normals_base": jnp.asarray(sides), "log_albedo_area": jnp.log(areas)})
    )
    chain = z + 1e-3 * rng.standard_normal((1, 20, problem.dim))
    chi2 = six_facets.misfit(problem, data, chain[0])[None]
    result = burn_in.BurnIn(problem, data, chain, chi2)
    assert result.remaining(result.best) == {6: 1.0}
