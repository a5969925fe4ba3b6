"""The main job from the command line: files in, files out, and the exit status."""

from __future__ import annotations

import csv
import fcntl
import json
import os
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import lcbayes
from lcbayes.cli.main import main
from lcbayes.core.errors import EXIT_BAD_INPUT, EXIT_DONE, EXIT_NOT_TRUSTED
from lcbayes.data.write import write
from tests.helpers import small_curves
from tests.helpers.refused_input import assert_refused

GOOD = small_curves.TRUSTED_FIT
POOR = ("--n-facets", "1", "--spin", "none", *small_curves.SHORT_RUN)
GROUPS = {
    "posterior",
    "sample_stats",
    "log_likelihood",
    "posterior_predictive",
    "prior",
    "observed_data",
    "constant_data",
    "modes/0",
}
KEYS = {
    "": {
        "model",
        "n_facets",
        "n_obs",
        "seed",
        "schema",
        "task",
        "trusted",
        "reasons",
        "max_rhat",
        "min_ess_bulk",
        "min_ess_tail",
        "divergences",
        "parameters",
        "modes",
        "fit",
        "timing",
    },
    "parameters": {"mean", "sd", "q05", "q50", "q95", "rhat", "ess_bulk"},
    "fit": {"rms", "chi2", "dof", "elpd_loo", "elpd_se", "log_evidence", "log_evidence_se"},
    "timing": {"compile_s", "warmup_s", "sampling_s", "gradients"},
}
MINE = '''
import numpyro
import numpyro.distributions as dist
from lcbayes.modelling import likelihood as noise
from lcbayes.core.jax_setup import jnp

SUMMARY = "a ball"

def model(data, *, depth: float = 1.0, dimmer: bool = False):
    """A diffuse ball of unknown size."""
    size = numpyro.sample("size", dist.LogNormal(0.0, 1.0))
    noise.observe(data, size * depth * (1 + jnp.cos(data.phase_angle)))
'''


@pytest.fixture(scope="module")
def curve(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("curve") / "curve.csv"
    write(small_curves.curve(20), path)
    return path


@pytest.fixture(scope="module")
def good(curve) -> tuple[Path, int]:
    out = curve.parent / "good"
    return out, main(["fit", str(curve), "-o", str(out), "--seed", "5", *GOOD])


def posterior(folder: Path, group: str = "posterior") -> dict[str, np.ndarray]:
    with xr.open_datatree(folder / "posterior.nc", engine="h5netcdf") as tree:
        return {str(k): v.values for k, v in tree[group].data_vars.items()}


def assert_same(a: Path, b: Path) -> None:
    one, two = posterior(a), posterior(b)
    assert one.keys() == two.keys()
    for name, values in one.items():
        np.testing.assert_array_equal(values, two[name], name)
    kept = [json.loads((x / "summary.json").read_text()) for x in (a, b)]
    for summary in kept:
        del summary["timing"]
    assert kept[0] == kept[1]


def test_done_with_every_file(good):
    out, status = good
    assert status == EXIT_DONE
    made = {p.name for p in out.iterdir()}
    assert {
        "posterior.nc",
        "summary.json",
        "run.toml",
        "report.html",
        "figures",
        "checkpoint",
    } <= made
    assert not list((out / "checkpoint").iterdir())


def test_finds_the_truth(good):
    found = posterior(good[0])
    area = found["albedo_area"]
    assert abs(area.mean() - small_curves.AREAS[0]) < 4 * area.std()
    np.testing.assert_allclose(np.linalg.norm(found["normals"], axis=-1), 1.0)


def test_summary_has_the_keys_of_the_design(good):
    summary = json.loads((good[0] / "summary.json").read_text())
    assert KEYS[""] <= summary.keys()
    assert KEYS["fit"] <= summary["fit"].keys()
    assert KEYS["timing"] <= summary["timing"].keys()
    for row in summary["parameters"].values():
        assert KEYS["parameters"] <= row.keys()
    assert summary["modes"][0]["weight"] == 1.0
    assert summary["trusted"] is True
    assert summary["reasons"] == []
    assert summary["fit"]["dof"] == pytest.approx(20 - 3, abs=0.1)


def test_posterior_has_the_groups_of_the_design(good):
    with xr.open_datatree(good[0] / "posterior.nc", engine="h5netcdf") as tree:
        assert {n.path.strip("/") for n in tree.subtree} >= GROUPS
        chains = {"chain": 4, "draw": 250}
        assert dict(tree["posterior"]["albedo_area"].sizes) == chains | {"facet": 1}
        assert dict(tree["posterior_predictive"]["brightness"].sizes) == chains | {"time": 20}
        dark = tree["log_likelihood_dark"].sizes["dark_time"]
        assert dict(tree["log_likelihood"]["brightness"].sizes) == chains | {"time": 20 - dark}
        assert np.all(tree["posterior"]["solution"] == 0)
        for group in ("sample_stats", "modes/0/sample_stats"):
            stats = tree[group].to_dataset()
            assert {"diverging", "energy", "acceptance_rate", "n_steps", "lp"} <= set(stats)
            assert dict(stats["lp"].sizes) == chains
            assert {"chain", "draw"} <= set(stats.coords)


def test_posterior_says_how_it_was_sampled_and_whether_to_trust_it(good):
    with xr.open_datatree(good[0] / "posterior.nc", engine="h5netcdf") as tree:
        assert tree.attrs["trusted"] == 1
        assert json.loads(tree.attrs["reasons"]) == []
        assert tree.attrs["version"]
        stats = tree["sample_stats"]
        assert stats.attrs["sampler"] == "nuts"
        assert "Fisher information" in stats.attrs["metric"]
        size, length = stats.attrs["step_size"], stats.attrs["trajectory_length"]
        assert size.shape == length.shape == (4,)
        np.testing.assert_array_equal(stats["step_size"].to_numpy()[:, 0], size)
        np.testing.assert_allclose(length, size * stats["n_steps"].mean("draw").to_numpy())


def test_arviz_reads_it(good):
    import arviz as az

    with xr.open_datatree(good[0] / "posterior.nc", engine="h5netcdf") as tree:
        assert float(az.rhat(tree["posterior"].to_dataset()[["g"]])["g"].max()) < 1.02


def test_same_seed_same_numbers(curve, good, tmp_path):
    main(["fit", str(curve), "-o", str(tmp_path / "b"), "--seed", "5", *GOOD, "--no-report"])
    assert_same(good[0], tmp_path / "b")


def test_config_gives_the_same_numbers(good, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # run.toml must not lean on the folder it was made in
    assert main(["fit", "--config", str(good[0] / "run.toml"), "-o", "again", "--no-report"]) == 0
    assert_same(good[0], tmp_path / "again")


def test_a_config_whose_curve_has_changed_is_refused(curve, good, tmp_path, capsys):
    theirs = tmp_path / "mine.csv"
    shutil.copy(curve, theirs)
    text = (good[0] / "run.toml").read_text().replace(str(curve), str(theirs))
    (tmp_path / "run.toml").write_text(text)
    theirs.write_text("\n".join(theirs.read_text().splitlines()[:-1]) + "\n")
    flags = ["fit", "--config", str(tmp_path / "run.toml"), "-o", str(tmp_path / "again")]
    assert_refused(flags, tmp_path / "again", "has changed since", capsys)


def test_another_seed_gives_others(curve, good, tmp_path):
    main(["fit", str(curve), "-o", str(tmp_path), "--seed", "6", *GOOD, "--no-report"])
    assert not np.array_equal(posterior(tmp_path)["g"], posterior(good[0])["g"])


def test_the_terminal_says_what_is_known(good):
    """Verdict, digits that the uncertainty bears, units."""
    summary = json.loads((good[0] / "summary.json").read_text())
    first, _, second, *rows = lcbayes.load(good[0]).text().splitlines()
    assert first == "One solution explains the data; the chains agree on it."
    assert re.fullmatch(r"solution 1: weight 1, rms 0\.\d+ relative to the curve's mean", second)
    (area,) = [row for row in rows if row.startswith("  albedo_area")]
    number = r"\d\.\d\d\d?"
    assert re.fullmatch(rf"  albedo_area\[0\] +{number} ± 0\.0\d\d? m² +{number} to {number}", area)
    row = summary["modes"][0]["parameters"]["albedo_area[0]"]
    low, high = (float(word) for word in area.split()[-3::2])
    assert (low, high) == pytest.approx((row["q05"], row["q95"]), abs=row["sd"] / 10)
    assert "what the result rests on:" in rows
    assert any("errors 1.4 times as large would widen" in line for line in rows)
    assert all(len(line) <= 80 for line in rows)
    moved = summary["rests_on"]["errors_1.4_times"]
    assert all(0.0 < shift < 0.41 for shift in moved.values())
    tables = good[0] / "tables"
    assert all(name in (tables / "rests_on.csv").read_text() for name in moved)
    tests = (tables / "residual_tests.csv").read_text().splitlines()
    assert {"chi2", "facet"} <= {line.partition(",")[0] for line in tests}


def test_too_few_draws_are_not_trusted(curve, tmp_path, capsys):
    status = main(["fit", str(curve), "-o", str(tmp_path), *POOR])
    assert status == EXIT_NOT_TRUSTED
    assert capsys.readouterr().out.startswith("DO NOT TRUST THIS RESULT")
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["trusted"] is False
    assert any("--num-samples" in reason["text"] for reason in summary["reasons"])
    html = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert summary["reasons"][0]["text"].split(":")[0] in html


def test_json_is_the_summary(curve, tmp_path, capsys):
    main(["fit", str(curve), "-o", str(tmp_path), *POOR, "--no-report", "--json"])
    said = capsys.readouterr()
    assert json.loads(said.out) == json.loads((tmp_path / "summary.json").read_text())
    assert said.err == ""


def test_a_users_model(curve, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("mine.py").write_text(MINE)
    flags = ["--set", "depth=0.5", "--set", "dimmer=true", *small_curves.SHORT_RUN, "--no-report"]
    status = main(["fit", str(curve), "-o", "out", "--model", "./mine.py", *flags])
    assert status == EXIT_NOT_TRUSTED  # a ball does not explain a facet
    assert "size" in posterior(Path("out"))
    assert main(["models", "./mine.py"]) == EXIT_DONE
    assert "dimmer" in capsys.readouterr().out
    shutil.move("out/run.toml", "run.toml")
    again = ["fit", "--config", "run.toml", "-o", "again", "--no-report"]
    assert main(again) == EXIT_BAD_INPUT  # no file that a folder names is run unasked
    assert "give --model FILE" in capsys.readouterr().err
    assert main([*again, "--model", "./mine.py"]) == EXIT_NOT_TRUSTED
    np.testing.assert_array_equal(posterior(Path("out"))["size"], posterior(Path("again"))["size"])


@pytest.mark.slow
def test_magnitudes_of_unknown_scale_and_noise(tmp_path):
    light = small_curves.magnitudes(40)
    write(light, tmp_path / "mag.csv")
    out = tmp_path / "out"
    assert (
        main(
            [
                "fit",
                str(tmp_path / "mag.csv"),
                "-o",
                str(out),
                *GOOD,
                "--num-samples",
                "800",
                "--no-report",
            ]
        )
        == 0
    )
    summary = json.loads((out / "summary.json").read_text())
    assert summary["fit"]["rms_unit"] == "mag"
    area = summary["parameters"]["albedo_area[0]"]
    assert area["q05"] - 3 * area["sd"] < small_curves.AREAS[0] < area["q95"] + 3 * area["sd"]


def test_predict_writes_a_csv(curve, good, tmp_path):
    out = tmp_path / "later.csv"
    assert main(["predict", str(good[0]), str(curve), "-o", str(out)]) == EXIT_DONE
    rows = list(csv.DictReader(out.read_text().splitlines()))
    assert len(rows) == 20
    names = ["flux_q05", "flux_q25", "flux_mean", "flux_q75", "flux_q95"]
    table = np.array([[float(r[n]) for n in names] for r in rows])
    assert np.all(np.diff(table[:, [0, 1, 3, 4]], axis=1) > 0)
    again = tmp_path / "again.csv"
    main(["predict", str(good[0]), str(curve), "-o", str(again)])
    assert again.read_bytes() == out.read_bytes()


def test_predict_needs_no_file_but_the_results(curve, good, tmp_path):
    """Neither the light curve that was fitted nor the folder it was fitted in."""
    moved, gone = tmp_path / "moved", tmp_path / "gone.csv"
    shutil.copytree(good[0], moved)
    text = (moved / "run.toml").read_text().replace(str(curve), str(gone))
    (moved / "run.toml").write_text(text)
    for folder, name in ((good[0], "a.csv"), (moved, "b.csv")):
        assert main(["predict", str(folder), str(curve), "-o", str(tmp_path / name)]) == EXIT_DONE
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()


def test_one_run_at_a_time_in_a_folder(curve, tmp_path, capsys):
    with open(tmp_path / ".lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        assert main(["fit", str(curve), "-o", str(tmp_path), *POOR]) == EXIT_BAD_INPUT
    assert "another run is writing" in capsys.readouterr().err
    assert [p.name for p in tmp_path.iterdir()] == [".lock"]


def test_a_file_in_place_of_the_folder(curve, tmp_path, capsys):
    (tmp_path / "taken").write_text("mine")
    assert main(["fit", str(curve), "-o", str(tmp_path / "taken"), *POOR]) == EXIT_BAD_INPUT
    assert "choose another with -o" in capsys.readouterr().err
    assert (tmp_path / "taken").read_text() == "mine"


@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser may write anywhere")
def test_a_folder_that_cannot_be_written(curve, tmp_path, capsys):
    tmp_path.chmod(0o500)
    assert main(["fit", str(curve), "-o", str(tmp_path / "out"), *POOR]) == EXIT_BAD_INPUT
    assert "choose another with -o" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("flags", "says"),
    [
        (
            ["--model", "convex"],
            "unknown model 'convex' (did you mean convex-grid?); available: faceted",
        ),
        (["--model", "./none.py"], "model file ./none.py does not exist"),
        (["--model", "convex-grid"], "needs 'period'; give it with --period"),
        (["--reflectance", "mirror"], "'reflectance' of model 'faceted' is 'mirror'; available"),
        (["--law", "lambertian"], "its reflectance law is chosen with --reflectance"),
        (["--noise", "cauchy"], "'noise_law' of model 'faceted' is 'cauchy'; available"),
        (["--spin", "sideways"], "'spin' of model 'faceted' is 'sideways'; available"),
        (["--n-facets", "0"], "--n-facets is 0; expected a whole number >= 1"),
        (["--set", "omega_sd"], "expected NAME=VALUE"),
        (["--set", "omega_sd=fast"], "'omega_sd' of model 'faceted' is 'fast'; expected float"),
        (["--set", "colour=red"], "no option 'colour'; available"),
        (["--sampler", "gibbs"], "--sampler is 'gibbs'; available: auto, nuts, ahmc, smc"),
        (["--num-samples", "3"], "--num-samples is 3; give a whole number >= 10"),
        (["--seed", "-1"], "--seed is -1; expected a whole number >= 0"),
        (["--config", "none.toml"], "none.toml"),
    ],
)
def test_wrong_options_are_reported_in_one_line(curve, tmp_path, capsys, flags, says):
    out = tmp_path / "out"
    assert_refused(["fit", str(curve), "-o", str(out), *flags], out, says, capsys)


@pytest.mark.parametrize("flags", [["fit"], ["fit", "x.csv"], ["predict", ".", "x", "-o", "y"]])
def test_what_is_missing_is_asked_for(flags, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(flags) == EXIT_BAD_INPUT
    assert "give" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
