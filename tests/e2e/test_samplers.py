"""`lcbayes fit --sampler NAME`: what is said of each, and how a stopped run goes on."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from lcbayes.cli.main import main
from lcbayes.core.checkpoint import Checkpoint
from lcbayes.core.errors import EXIT_BAD_INPUT
from lcbayes.data.write import write
from lcbayes.tasks.fit.run import fit_with_kernel
from tests.helpers import small_curves

PROBLEM = ("--n-facets", "1", "--spin", "none", "--num-starts", "16", "--no-report")


@pytest.fixture(scope="module")
def curve(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("curve") / "curve.csv"
    write(small_curves.curve(20), path)
    return path


def fit(curve: Path, out: Path, sampler: str, *more: str) -> list[str]:
    return ["fit", str(curve), "-o", str(out), "--sampler", sampler, "--seed", "2", *PROBLEM, *more]


@pytest.mark.slow
def test_the_published_sampler_is_never_trusted():
    few: dict[str, Any] = {"num_warmup": 100, "num_samples": 100, "num_chains": 2, "num_starts": 16}
    problem: dict[str, Any] = {"n_facets": 1, "spin": "none", "seed": 2} | few
    result = fit_with_kernel(small_curves.curve(40), "ahmc-paper", **problem)
    assert not result.trusted
    assert result.reasons[0].code == "published-sampler"
    assert result.text().startswith("DO NOT TRUST THIS RESULT")
    assert "the published sampler is biased" in result.text()


def test_kernels_for_comparison_are_not_offered(curve, tmp_path, capsys):
    assert main(fit(curve, tmp_path / "out", "mh")) == EXIT_BAD_INPUT
    assert "--sampler is 'mh'; available: auto, nuts, ahmc, smc" in capsys.readouterr().err


# ------------------------------------------------------------------------- stop and go on


class KilledError(BaseException):
    """What no handler of the package catches."""


# Few draws of a sampler, and with how many pieces on disk to stop: after the search there is one,
# then they come block by block, or population by population.
SHORT_RUN = {
    "ahmc": (("--num-warmup", "100", "--num-samples", "100", "--num-chains", "2"), (2, 4)),
    "smc": (("--num-samples", "20", "--num-chains", "3"), (2, 4)),
}


def stopped(monkeypatch, command: list[str], n_stored: int) -> None:
    """The command, stopped as soon as its checkpoint holds ``n_stored`` pieces."""
    save = Checkpoint.save

    def save_or_stop(self, name, arrays):
        save(self, name, arrays)
        if len(list(self.folder.glob("[!.]*.npz"))) == n_stored:
            raise KilledError

    with monkeypatch.context() as patch:
        patch.setattr(Checkpoint, "save", save_or_stop)
        with pytest.raises(KilledError):
            main(command)


@pytest.mark.parametrize("sampler", [pytest.param("ahmc", marks=pytest.mark.slow), "smc"])
def test_a_stopped_run_goes_on_to_the_same_numbers(sampler, curve, tmp_path, monkeypatch, capsys):
    """Stopped early and again late; the exact state is on disk."""
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    few, stops = SHORT_RUN[sampler]
    main(fit(curve, whole, sampler, *few))
    command = fit(curve, broken, sampler, *few)
    for n_stored in stops:
        stopped(monkeypatch, command, n_stored)
        assert not (broken / "posterior.nc").exists()
    capsys.readouterr()
    main(command)
    assert "resuming the run" in capsys.readouterr().err
    compared = 0
    with (
        xr.open_datatree(whole / "posterior.nc", engine="h5netcdf") as one,
        xr.open_datatree(broken / "posterior.nc", engine="h5netcdf") as two,
    ):
        assert [n.path for n in one.subtree] == [n.path for n in two.subtree]
        for node in one.subtree:
            for name, values in node.data_vars.items():
                other = two[node.path].data_vars[name]
                np.testing.assert_array_equal(values.values, other.values, f"{node.path}/{name}")
                compared += 1
    assert compared > 20


def test_particles_are_refused_where_the_prior_is_too_wide(curve, tmp_path, capsys):
    out = tmp_path / "out"
    command = ["fit", str(curve), "-o", str(out), "--model", "convex-grid", "--period", "0.02"]
    assert main([*command, "--sampler", "smc"]) == EXIT_BAD_INPUT
    assert "too far a way for convex-grid" in capsys.readouterr().err
    assert not out.exists()


@pytest.mark.slow
def test_config_keeps_the_sampler(curve, tmp_path):
    """A run.toml names its sampler and its warm-up, so `--config` gives the same draws."""
    first, again = tmp_path / "first", tmp_path / "again"
    main(fit(curve, first, "ahmc", "--num-samples", "50", "--num-chains", "2"))
    main(["fit", "--config", str(first / "run.toml"), "-o", str(again), "--no-report"])
    draws = []
    for folder in (first, again):
        with xr.open_datatree(folder / "posterior.nc", engine="h5netcdf") as tree:
            draws.append(tree["posterior"]["log_albedo_area"].values)
    np.testing.assert_array_equal(*draws)
    assert 'sampler = "ahmc"' in (again / "run.toml").read_text()
