"""`lcbayes batch` from the command line: a damaged file among good ones, and the same again."""

from __future__ import annotations

import csv
import json
from contextlib import contextmanager

import pytest
import xarray as xr

import lcbayes
from lcbayes.cli.main import main
from lcbayes.core import cluster
from lcbayes.core.errors import EXIT_BAD_INPUT, EXIT_DONE, EXIT_INTERRUPTED, EXIT_NOT_TRUSTED
from lcbayes.data.write import write
from lcbayes.tasks.batch import worker
from tests.helpers import small_curves


@pytest.fixture
def catalogue(tmp_path, monkeypatch):
    """Three objects, the second cut off in a line; done by threads, which need no other process."""
    monkeypatch.setattr(cluster, "find_spec", lambda _: None)
    for i in range(3):
        write(
            small_curves.curve(20, seed=i), tmp_path / f"{i}.csv"
        )  # one structure, one compilation
    text = (tmp_path / "1.csv").read_text().splitlines()
    (tmp_path / "1.csv").write_text("\n".join([*text[:9], text[9][:12]]) + "\n")
    path = tmp_path / "night.csv"
    path.write_text("name,curve,seed\nfirst,0.csv,1\nsecond,1.csv,1\nthird,2.csv,5\n")
    return path


@contextmanager
def stopping(*_, **__):
    """Workers that do the first object, and then somebody stops the run."""

    def run(function, shared, tasks):
        yield 0, function(shared, *tasks[0])
        raise KeyboardInterrupt

    yield run


def test_batch_stops_resumes_goes_past_a_fault_and_mends(catalogue, tmp_path, monkeypatch, capsys):
    out = tmp_path / "out"
    command = ["batch", str(catalogue), "-o", str(out), *small_curves.TRUSTED_FIT]
    with monkeypatch.context() as patch:
        patch.setattr(cluster, "worker_pool", stopping)
        assert main(command) == EXIT_INTERRUPTED
    assert "2 of 3 objects were not done" in (out / "summary.json").read_text()
    fit_object, done = worker.fit_object, []

    def counted(shared, one):
        done.append(one.name)
        return fit_object(shared, one)

    monkeypatch.setattr(worker, "fit_object", counted)
    assert main(command) == EXIT_NOT_TRUSTED
    assert sorted(done) == ["second", "third"]
    read = list(csv.DictReader((out / "tables" / "objects.csv").read_text().splitlines()))
    assert [r["status"] for r in read] == ["trusted", "failed", "trusted"]
    with xr.open_datatree(out / "objects/first/posterior.nc", engine="h5netcdf") as tree:
        total = tree["posterior"].to_dataset()["albedo_area"].sum("facet")
        assert float(read[0]["albedo_area_m2"]) == pytest.approx(float(total.mean()))
        assert float(read[0]["albedo_area_m2_sd"]) == pytest.approx(float(total.std()))
    assert "1.csv, line 10" in read[1]["reasons"]
    said = json.loads((out / "summary.json").read_text())
    assert said["n_failed"] == 1
    assert said["reasons"] == [{"code": "objects-failed", "text": "1 of 3 objects failed: second"}]
    assert (out / "objects" / "third" / "posterior.nc").is_file()
    assert json.loads((out / "objects" / "third" / "summary.json").read_text())["seed"] == 5
    assert "DO NOT TRUST" in capsys.readouterr().out

    write(small_curves.curve(20, seed=1), tmp_path / "1.csv")  # mended: it alone is done
    done.clear()
    assert main(command) == EXIT_DONE
    assert done == ["second"]
    assert lcbayes.load(out).trusted
    assert (
        lcbayes.load(out / "objects" / "first").summary()["parameter"].iloc[0] == "albedo_area[0]"
    )
    assert "3 of 3 objects" in (out / "report.html").read_text()


def test_faults_of_the_request_are_reported_before_anything_is_done(catalogue, tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["batch", str(catalogue), "-o", str(out), "--set", "facetts=2"]) == EXIT_BAD_INPUT
    assert "facetts" in capsys.readouterr().err
    assert main(["batch", str(tmp_path / "no.csv"), "-o", str(out)]) == EXIT_BAD_INPUT
    assert "does not exist" in capsys.readouterr().err
    assert not out.exists()
