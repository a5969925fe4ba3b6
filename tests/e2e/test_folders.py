"""Results folders: they stand alone, and opening one never runs code that it names."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import lcbayes
from lcbayes.cli.main import main
from lcbayes.core.errors import EXIT_BAD_INPUT, EXIT_DONE, EXIT_NOT_TRUSTED, InputError
from tests.helpers import small_curves

SHORT_RUN = {"num_warmup": 10, "num_samples": 20, "num_starts": 16, "num_chains": 2}
ONE = {"n_facets": 1, "spin": "none", "seed": 1, **SHORT_RUN}
MINE = """
from pathlib import Path

import numpyro
import numpyro.distributions as dist
from lcbayes.modelling import likelihood as noise

Path("{marker}").write_text("run")

def model(data, *, depth: float = 1.0):
    size = numpyro.sample("size", dist.LogNormal(0.0, 1.0))
    noise.observe(data, size * depth * (1.0 + data.phase_angle))
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A fit made in Python, moved, and the light curve deleted."""
    place = tmp_path_factory.mktemp("python")
    lcbayes.write(small_curves.curve(20), place / "pass.csv")
    curve = lcbayes.read(place / "pass.csv", error_floor=0.01)
    lcbayes.fit(curve, out=place / "out", report=False, **ONE)
    shutil.move(place / "out", place / "moved")
    (place / "pass.csv").unlink()
    return place / "moved"


def test_a_moved_folder_is_used_without_the_files_it_was_made_of(folder, tmp_path, capsys):
    lcbayes.write(small_curves.curve(12, seed=3), tmp_path / "later.csv")
    out = tmp_path / "brightness.csv"
    status = main(["predict", str(folder), str(tmp_path / "later.csv"), "-o", str(out)])
    assert status == EXIT_NOT_TRUSTED  # 40 draws are too few
    rows = out.read_text().splitlines()
    assert rows[0].split(",")[-1] == "trusted"
    assert {row.split(",")[-1] for row in rows[1:]} == {"false"}
    assert "DO NOT TRUST" in capsys.readouterr().out
    assert main(["report", str(folder)]) == EXIT_NOT_TRUSTED
    assert (folder / "report.html").is_file()


COMPARE = ["--n-facets", "1,2", "--spin", "none", "--num-runs", "2"]
COMPARE += ["--evidence", "particles", "--num-particles", "10"]


@pytest.mark.slow
def test_a_moved_folder_is_compared_without_the_files_it_was_made_of(folder, tmp_path):
    command = ["compare", str(folder), "-o", str(tmp_path / "c"), *COMPARE, "--num-starts", "4"]
    assert main([*command, "--no-report"]) in (EXIT_DONE, EXIT_NOT_TRUSTED)


def test_compare_takes_the_curve_from_a_moved_folder(folder, tmp_path, monkeypatch):
    given = []

    def stop(curve, *_):
        given.append(curve)
        raise InputError("stopped")

    monkeypatch.setattr("lcbayes.inference.facet_count.run", stop)
    assert main(["compare", str(folder), "-o", str(tmp_path / "c"), *COMPARE]) == EXIT_BAD_INPUT
    (curve,) = given
    fit = lcbayes.load(folder)
    assert isinstance(fit, lcbayes.Fit)
    for name in ("t", "brightness", "error", "sun", "obs"):
        np.testing.assert_array_equal(getattr(curve, name), getattr(fit.light_curve, name))


def test_how_a_curve_was_read_is_recorded_also_from_python(folder, capsys, tmp_path):
    text = (folder / "run.toml").read_text()
    assert "[reading]\nerror_floor = 0.01" in text
    assert "[input.curve]" in text
    assert main(["fit", "--config", str(folder / "run.toml"), "-o", str(tmp_path / "x")]) == 2
    said = capsys.readouterr().err
    assert "pass.csv, an input of" in said
    assert "is not there; put it back, or give the curve" in said
    assert said.count("\n") == 1
    assert not (tmp_path / "x").exists()


def test_a_loaded_fit_is_the_fit(folder):
    fit = lcbayes.load(folder)
    assert isinstance(fit, lcbayes.Fit)
    assert (fit.trusted, bool(fit.reasons)) == (False, True)
    assert "few-effective-draws" in {reason.code for reason in fit.reasons}
    assert list(fit.summary()["parameter"]) == ["albedo_area[0]", "g[0]", "phi[0]"]
    assert fit.light_curve.n_obs == 20
    assert fit.tree.attrs["trusted"] == 0
    assert "DO NOT TRUST" in fit._repr_html_()
    assert len(fit.plot_light_curve()) >= 1
    summary = json.loads((folder / "summary.json").read_text())
    assert (summary["schema"], summary["task"], summary["trusted"]) == (4, "fit", False)
    assert [r["text"] for r in summary["reasons"]] == [r.text for r in fit.reasons]


def test_a_small_task_is_loaded_with_its_tables(tmp_path):
    curve = lcbayes.simulate("box-wing", seed=1).data
    lcbayes.spin(curve, shuffles=99, out=tmp_path / "s", report=False)
    result: Any = lcbayes.load(tmp_path / "s")
    assert result.task == "spin"
    assert set(result.tables()) == {"solutions", "synodic_periods"}
    with pytest.raises(InputError, match="has no figures; run the task again"):
        result.plot_pole()  # pyright: ignore[reportAttributeAccessIssue]
    with pytest.raises(InputError, match="are drawn only when it runs"):
        lcbayes.report(tmp_path / "s")


@pytest.mark.slow
def test_curves_of_unknown_errors_are_predicted_each_at_its_noise(tmp_path):
    """A fit of two curves without errors; predicted for three others, one of them of its names."""
    curve = small_curves.curve(24)
    two = np.repeat([0, 1], 12)
    names = ("a", "b")
    relative = lcbayes.LightCurve(
        t=curve.t,
        brightness=curve.brightness,
        error=None,
        sun=curve.sun,
        obs=curve.obs,
        kind="flux",
        curve=two,
        curve_names=names,
        free_scale=np.array([True, True]),
    )
    lcbayes.write(relative, tmp_path / "two.csv")
    fit = lcbayes.fit(relative, out=tmp_path / "out", report=False, **ONE)
    assert "noise" in fit.posterior
    predicted = lcbayes.predict(tmp_path / "out", tmp_path / "two.csv")
    table = predicted.summary()
    assert len(table) == 24
    mean = table["flux_mean"].to_numpy()
    inside = (relative.brightness > table["flux_q05"]) & (relative.brightness < table["flux_q95"])
    assert inside.mean() > 0.6
    assert np.corrcoef(mean, relative.brightness)[0, 1] > 0.9


# ------------------------------------------------------------------------- models that are files


@pytest.fixture(scope="module")
def of_a_file(tmp_path_factory) -> tuple[Path, Path, Path]:
    """Folder of a fit whose model is a file, that file, and what it writes when it is run."""
    place = tmp_path_factory.mktemp("file")
    marker, model = place / "marker", place / "mine.py"
    model.write_text(MINE.format(marker=marker))
    lcbayes.fit(
        small_curves.curve(20), model=str(model), out=place / "out", report=False, **SHORT_RUN
    )
    lcbayes.write(small_curves.curve(20), place / "later.csv")
    assert marker.is_file()
    return place / "out", model, marker


@pytest.fixture
def quiet(of_a_file):
    of_a_file[2].unlink(missing_ok=True)
    return of_a_file


def commands(folder: Path, out: Path) -> dict[str, list[str]]:
    later = str(folder.parent / "later.csv")
    return {
        "predict": ["predict", str(folder), later, "-o", str(out / "p.csv")],
        "config": ["fit", later, "--config", str(folder / "run.toml"), "-o", str(out / "again")],
        "observability": [
            *("observability", "one-facet", "-o", str(out / "obs"), "--plan", "2"),
            *("--posterior", str(folder)),
        ],
    }


@pytest.mark.parametrize("name", ["predict", "config", "observability"])
def test_no_command_runs_the_file_that_a_folder_names(quiet, tmp_path, capsys, name):
    folder, model, marker = quiet
    command = commands(folder, tmp_path)[name]
    assert main(command) == EXIT_BAD_INPUT
    said = [x for x in capsys.readouterr().err.splitlines() if x.startswith("lcbayes ")]
    assert len(said) == 1
    assert "give --model FILE" in said[0]
    assert not marker.exists()
    changed = tmp_path / "mine.py"
    changed.write_text(model.read_text() + "\n# changed\n")
    assert main([*command, "--model", str(changed)]) == EXIT_BAD_INPUT
    assert "its SHA-256 differs" in capsys.readouterr().err
    assert not marker.exists()


def test_the_file_that_was_fitted_is_run_where_it_is_given(quiet, tmp_path):
    folder, model, marker = quiet
    predict = commands(folder, tmp_path)["predict"]
    assert main([*predict, "--model", str(model)]) == EXIT_NOT_TRUSTED
    assert marker.exists()


def test_loading_reporting_and_listing_run_nothing(quiet):
    folder, _, marker = quiet
    assert lcbayes.load(folder).summary()["parameter"].iloc[0] == "size"
    assert main(["report", str(folder)]) == EXIT_NOT_TRUSTED
    assert not marker.exists()


def test_a_folder_that_says_its_file_is_another_is_refused(quiet, tmp_path, capsys):
    """A hash that is missing is not one that is right."""
    folder, model, marker = quiet
    other = shutil.copytree(folder, tmp_path / "out")
    text = (other / "run.toml").read_text()
    (other / "run.toml").write_text(text.replace("[input.model]", "[input.other]"))
    command = ["predict", str(other), str(folder.parent / "later.csv"), "-o", str(tmp_path / "p")]
    assert main([*command, "--model", str(model)]) == EXIT_BAD_INPUT
    assert "its SHA-256 differs" in capsys.readouterr().err
    assert not marker.exists()
