"""`lcbayes compare` from the command line: files in, files out, and the exit status."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

import lcbayes
from lcbayes.cli.main import main
from lcbayes.core.checkpoint import Checkpoint
from lcbayes.core.errors import (
    EXIT_BAD_INPUT,
    EXIT_DONE,
    EXIT_INTERRUPTED,
    EXIT_NOT_TRUSTED,
    InputError,
)
from lcbayes.data.write import write
from lcbayes.inference import chain_evidence, facet_count, screening
from lcbayes.modelling.epochs import Epochs
from lcbayes.tasks.compare.options import numbers
from lcbayes.tasks.compare.result import Comparison
from tests.helpers import one_facet_posterior, small_curves
from tests.helpers.refused_input import assert_refused

SHORT_RUN = (
    "--n-facets",
    "1-2",
    "--spin",
    "none",
    "--num-particles",
    "30",
    "--num-runs",
    "2",
    "--num-starts",
    "8",
    "--seed",
    "1",
    "--sparse",
    "2",
)
RELIED_ON = 0.2  # nats; with the default, 0.3, it would be chance whether two facets are in doubt
FEW: dict[str, Any] = {
    "n_facets": (1, 2),
    "spin": "none",
    "num_particles": 12,
    "num_runs": 2,
    "num_starts": 8,
}


@pytest.fixture(scope="module")
def curve(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("curve") / "curve.csv"
    write(small_curves.curve(16), path)
    return path


class Ran(NamedTuple):
    """A comparison in a folder, and what the measurement by chains of each number was given."""

    out: Path
    status: int
    evidence: str
    given: list[tuple]


@pytest.fixture(
    scope="module", params=["chains", pytest.param("particles", marks=pytest.mark.slow)]
)
def result(request, curve) -> Ran:
    """A run that is stopped once and goes on, with an evidence of each kind.

    That it comes to the numbers of one that is not stopped is held by test_replicates.py.
    """
    evidence = request.param
    out, save, stored = curve.parent / evidence, Checkpoint.save, []
    command = ["compare", str(curve), "-o", str(out), "--evidence", evidence, *SHORT_RUN]
    estimate, given = chain_evidence.estimate, []

    def save_or_stop(self, name, arrays):
        save(self, name, arrays)
        stored.append(self._prefix + name)
        if len(stored) == 3:
            raise KeyboardInterrupt

    def recorded(*args):
        given.append(args)
        return estimate(*args)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Checkpoint, "save", save_or_stop)
        assert main(command) == EXIT_INTERRUPTED
    searches = "ends" if evidence == "chains" else "search"
    assert stored[:2] == [f"{searches}-1", f"{searches}-2"]
    assert stored[2].startswith("facets-1-")  # the lowest information criterion
    assert not (out / "summary.json").exists()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Checkpoint, "save", lambda self, name, _: stored.append(self._prefix + name))
        patch.setattr(chain_evidence, "estimate", recorded)
        patch.setattr(chain_evidence, "MAX_SE", RELIED_ON)
        status = main(command)
    assert len(set(stored)) == len(stored)  # nothing is done twice
    particles = () if evidence == "chains" else (1, 2)
    assert [name for name in stored if "-run-" in name] == [
        f"facets-{n}-run-{i}" for n in particles for i in (0, 1)
    ]
    return Ran(out, status, evidence, given)


def test_what_is_written(result, curve):
    out, status = result.out, result.status
    assert {p.name for p in out.iterdir() if p.name[0] != "."} == {
        "summary.json",
        "tables",
        "report.html",
        "run.toml",
        "figures",
        "checkpoint",
        "facets-1",
        "facets-2",
    }
    content = json.loads((out / "summary.json").read_text())
    assert status == (EXIT_DONE if content["trusted"] else EXIT_NOT_TRUSTED)
    assert [row["n_facets"] for row in content["candidates"]] == [1, 2]
    assert sum(row["probability"] for row in content["candidates"]) == pytest.approx(1.0)
    for row in content["candidates"]:
        assert len(row["log_evidences"]) == 2
        assert np.isfinite([row["log_evidence"], row["elpd_loo"], row["log_prior_mass"]]).all()
        assert row["chi2"] < 80
    table = (out / "tables" / "candidates.csv").read_text()
    rows = list(csv.DictReader(table.splitlines()))
    assert float(rows[1]["log_evidence"]) == content["candidates"][1]["log_evidence"]
    assert str(curve) in (out / "run.toml").read_text()


def test_the_evidence_of_one_facet_is_that_of_quadrature(result, curve):
    """ln Z under the prior given that the facet is seen, within 0.6 of two runs of 30 particles and
    0.15 of chains."""
    content = json.loads((result.out / "summary.json").read_text())
    row, centre = content["candidates"][0], np.log(content["area_prior"]["median_m2"])
    assert row["evidence_from"] == result.evidence
    assert row["chains_doubted"] == ""
    data = Epochs.of(lcbayes.read(curve))
    grid = one_facet_posterior.Quadrature.of(data)  # with the median 1 m²
    log_area = grid.axes[0]
    ratio = np.exp(0.5 * log_area**2 - 0.5 * (log_area - centre) ** 2)
    exact = grid.log_evidence(data) + np.log(grid.marginal("log_albedo_area") @ ratio)
    error = {"chains": 0.15, "particles": 0.6}[result.evidence]
    assert row["log_evidence"] + row["log_prior_mass"] == pytest.approx(exact, abs=error)
    if result.evidence == "chains":
        assert row["log_evidence_se"] < chain_evidence.MAX_SE


def test_a_superfluous_facet_is_weighed_against_one_fewer(result, monkeypatch):
    """Two facets, of which the data determine one: a Gaussian does not describe the second."""
    row = json.loads((result.out / "summary.json").read_text())["candidates"][1]
    assert row["n_facets"] == 2
    assert row["evidence_from"] == result.evidence
    assert row["log_evidence_se"] < 0.6
    if result.evidence == "particles":
        assert not result.given
        return
    (given,) = (args for args in result.given if args[0].plain.dim == 8)
    monkeypatch.setattr(chain_evidence, "MAX_SE", RELIED_ON)
    assert chain_evidence.estimate(*given).doubt.startswith("the bridges are uncertain by")
    assert row["log_evidence_se"] < np.hypot(RELIED_ON, RELIED_ON)  # of the ratio, and of one facet


@pytest.mark.slow
def test_chains_that_are_doubted_give_way_to_particles(monkeypatch):
    monkeypatch.setattr(chain_evidence, "MAX_SE", -1.0)
    compared = lcbayes.compare(small_curves.curve(16), **FEW)
    for row in compared.content["candidates"]:
        assert row["evidence_from"] == "particles"
        assert row["chains_doubted"].startswith("the bridges are uncertain by")


def test_a_search_without_an_end_is_refused(curve, monkeypatch):
    monkeypatch.setattr(facet_count, "_best_fit", lambda *_: None)
    with pytest.raises(InputError, match="no start of the search has a finite posterior density"):
        lcbayes.compare(lcbayes.read(curve), n_facets=(1, 2), spin="none", evidence="particles")


def test_every_number_keeps_its_posterior_figures_and_page(result):
    """Also after the comparison is loaded and saved elsewhere."""
    out = result.out
    for n in (1, 2):
        within = out / f"facets-{n}"
        assert {"posterior.nc", "summary.json", "tables", "figures", "report.html"} <= {
            p.name for p in within.iterdir()
        }
        assert any((within / "figures").glob("*.svg"))
    again = lcbayes.load(out)
    assert isinstance(again, Comparison)
    assert sorted(again.fits) == [1, 2]
    assert again.fits[2].posterior["albedo_area"].shape[2] == 2
    again.save(out.parent / "copy")
    assert (out.parent / "copy" / "facets-2" / "posterior.nc").is_file()
    again.write_report()
    assert (out / "facets-1" / "report.html").is_file()


def test_the_prior_on_areas_is_that_of_the_data(result):
    """The one facet has 6 m²; smaller medians favour more and smaller ones."""
    content = json.loads((result.out / "summary.json").read_text())["area_prior"]
    assert content["from_data"]
    assert content["median_m2"] == pytest.approx(6.0, rel=0.2)
    one = {row["median_m2"]: row["probability"][0] for row in content["scan"]}
    assert min(one) < content["median_m2"] < max(one)
    assert list(one.values()) == sorted(one.values())
    assert one[content["median_m2"]] > one[min(one)]


def test_the_sparse_path(result):
    """From two facets it ends at one or two, of which the table marks one."""
    path = json.loads((result.out / "summary.json").read_text())["sparse"]
    assert path["upper_bound"] == 2
    assert sum(path["shares"].values()) == pytest.approx(1.0)
    assert path["n_facets"] in (1, 2)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (("--facets", "3"), "give two numbers or more"),
        (("--facets", "4-2"), "'4-2' is no number or range; expected 1-8 or 1,2,4"),
        (("--facets", "1,x"), "'x' is no number or range"),
        (("--facets", "0-2"), "give numbers from 1 to 50"),
        (("--num-runs", "1"), "--num-runs is 1; expected a whole number >= 2"),
        (("--num-particles", "3"), "--num-particles is 3"),
        (("--model", "convex-grid"), "--model convex-grid has no number of facets"),
        (("--model", "round"), "unknown model 'round'"),
        (("--set", "n_facets=3"), "give two numbers or more"),
        (("--set", "colour=3"), "no option 'colour'"),
        (("--set", "omega_sd"), "expected NAME=VALUE"),
        (("--sparse", "1"), "--sparse is 1; expected a whole number >= 2"),
        (("--reflectance", "shiny"), "'shiny'"),
        (("--law", "shiny"), "is chosen with --reflectance"),
    ],
)
def test_faults_are_reported_in_a_line(curve, tmp_path, capsys, given, says):
    out = tmp_path / "out"
    command = ["compare", str(curve), "-o", str(out), "--n-facets", "1-2", *given]
    assert_refused(command, out, says, capsys)


def test_a_folder_is_needed(curve, capsys):
    assert main(["compare", str(curve)]) == EXIT_BAD_INPUT
    assert "-o DIR" in capsys.readouterr().err


def test_numbers_of_facets():
    assert numbers("1-4") == (1, 2, 3, 4)
    assert numbers("1,2, 4") == (1, 2, 4)
    assert numbers("1-3,6") == (1, 2, 3, 6)
    for text in ("", "1-", "-2", "1.5", "1 2", "1e9"):
        with pytest.raises(InputError, match="expected 1-8 or 1,2,4"):
            numbers(text)


@pytest.mark.slow
def test_a_search_that_fails_does_not_rule_out_more_facets_than_fit(monkeypatch):
    """Two facets include one: whatever the search found for two, it has a chance."""
    search = facet_count._best_fit

    def poor_for_two(problem, data, key, n, *rest):
        z = search(problem, data, key, n, *rest)
        if n == 2:
            sites = problem.unravel(z)
            z = problem.ravel({**sites, "log_albedo_area": sites["log_albedo_area"] - 5.0})
        return np.asarray(z)

    monkeypatch.setattr(facet_count, "_best_fit", poor_for_two)
    monkeypatch.setattr(screening, "largest_likelihood", lambda _p, _d, z, *_: (-1e4, z[0]))
    compared = lcbayes.compare(small_curves.curve(16), evidence="particles", **FEW)
    assert sorted(compared.probability) == [1, 2]
    assert compared.probability[2] > 0.0
