"""`lcbayes scan` from a file to its results, and its refusals."""

from __future__ import annotations

import csv
import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

import lcbayes
from lcbayes.cli import main
from lcbayes.core.errors import EXIT_BAD_INPUT, EXIT_DONE
from lcbayes.core.files import write_json
from lcbayes.physics.bodies import mesh
from tests.helpers import damit_model, spinning_bodies
from tests.helpers.refused_input import assert_refused
from tests.helpers.results_folders import figures

POLE, PERIOD, NOISE = np.array([0.48, -0.6, 0.64]), 5.0, 0.003
QUICK = ["--n-poles", "10", "--keep", "3", "--n-facets", "300", "--degree", "4", "--n-sky", "30"]


@pytest.fixture(scope="module")
def asteroid(tmp_path_factory):
    """A curve file and the results of a scan of it."""
    folder = tmp_path_factory.mktemp("scan")
    curve = spinning_bodies.observed(
        spinning_bodies.geometry(10, 12, days=60.0), POLE, PERIOD, NOISE
    )
    lcbayes.write(replace(curve, epoch_jd=2450000.5), folder / "asteroid.csv")
    argv = ["scan", str(folder / "asteroid.csv"), "--period-range", "4.99,5.01", *QUICK]
    return folder, argv, main.main([*argv, "-o", str(folder / "out")])


def test_a_spin_from_file_to_page(asteroid, capsys, look):
    folder, argv, status = asteroid
    out = folder / "out"
    assert status == EXIT_DONE
    result = json.loads((out / "summary.json").read_text())
    assert result["trusted"]
    best = result["solutions"][0]
    assert best["period_h"] == pytest.approx(PERIOD, abs=2e-4)
    pole = np.radians([best["pole_lon_deg"], best["pole_lat_deg"]])
    near = POLE @ [
        np.cos(pole[0]) * np.cos(pole[1]),
        np.sin(pole[0]) * np.cos(pole[1]),
        np.sin(pole[1]),
    ]
    assert np.degrees(np.arccos(near)) < 5.0
    assert best["rms"] == pytest.approx(NOISE, rel=0.3)
    omega = [best[f"omega_{axis}_rad_s"] for axis in "xyz"]
    span_h = np.ptp(lcbayes.read(folder / "asteroid.csv").t) / 3600
    assert best["period_resolution_h"] == pytest.approx(best["period_h"] ** 2 / span_h)
    assert f"period {best['period_h']:.4f} h" in (out / "report.html").read_text()
    assert np.linalg.norm(omega) == pytest.approx(2 * np.pi / (3600 * best["period_h"]))
    assert result["n_periods"] == 3
    assert result["n_hypotheses"] == 10 * (3 + 2)  # and twice and half the best
    chi2 = [s["chi2"] for s in result["solutions"]]
    assert chi2 == sorted(chi2)
    with (out / "tables" / "hypotheses.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == result["n_hypotheses"]
    assert min(float(r["chi2"]) for r in rows) > 0
    look(out / "report.html")
    page = (out / "report.html").read_text()
    assert "Best spin: pole (" in page
    assert "http" not in page.replace("http-equiv", "").replace("http://www.w3.org", "")
    assert figures(out) == {"sky", "periods", "fit", "shape"}
    assert len(mesh.read_body(out / "shape.obj").areas) > 20
    assert not list(out.glob(".report*"))
    # the exported triangles, rotated by the convention of DAMIT, fit the data as the scan does
    curve = lcbayes.read(folder / "asteroid.csv")
    assert curve.epoch_jd is not None
    flux = damit_model.read(out).flux(curve.epoch_jd + curve.t / 86400.0, curve.sun, curve.obs)
    count = np.bincount(curve.curve)
    mean, modelled = (np.bincount(curve.curve, x) / count for x in (curve.brightness, flux))
    residual = curve.brightness / mean[curve.curve] - flux / modelled[curve.curve]
    assert np.sqrt(np.mean(residual**2)) == pytest.approx(best["rms"], rel=0.1)
    # the same command gives the same numbers
    again = [*argv, "-o", str(folder / "again"), "--json", "--no-report"]
    assert main.main(again) == EXIT_DONE
    answer = json.loads(capsys.readouterr().out)
    assert answer["solutions"] == result["solutions"]


def test_a_fit_starts_from_a_scan(asteroid):
    """Where the scan ended, in the model's own terms, is where the search begins."""
    from lcbayes.core.jax_setup import jax, jnp
    from lcbayes.inference.start_from import placed
    from lcbayes.modelling import registry
    from lcbayes.modelling.epochs import Epochs
    from lcbayes.modelling.problem import Problem
    from lcbayes.results.start import read_start

    folder, _, _ = asteroid
    curve = lcbayes.read(folder / "asteroid.csv")
    spins = read_start(folder / "out", curve).spins
    options = {"period": 5.0, "n_facets": 300, "degree": 4, "noise_law": "gaussian"}
    entry, data = registry.find("convex-grid"), Epochs.of(curve)
    problem = Problem(entry.bind(options), data)
    hook = entry.hook("starts")
    assert hook is not None
    given = [problem.ravel(s) for s in hook(data, jax.random.key(0), **options)]
    z = placed(spins, jnp.stack(given), problem, data, options, entry.hook("shapes"))
    assert len(z) == 2 * len(spins)
    sites = problem.constrain(z[0], data)
    assert float(sites["period_h"]) == pytest.approx(spins[0]["period_h"], rel=1e-9)
    assert float(sites["pole_lon_deg"]) == pytest.approx(spins[0]["pole_lon_deg"], abs=1e-6)
    flux = np.asarray(problem.flux({k: sites[k] for k in problem.names}, data))
    scale = np.bincount(curve.curve, curve.brightness * flux) / np.bincount(curve.curve, flux**2)
    mean = (np.bincount(curve.curve, curve.brightness) / np.bincount(curve.curve))[curve.curve]
    residual = (curve.brightness - scale[curve.curve] * flux) / mean
    # the grid of normals is turned with the body's axes: not to the last digit
    assert np.sqrt(np.mean(residual**2)) == pytest.approx(spins[0]["rms"], abs=1e-3)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ([], "nothing to try: give --period HOURS, --period-range FROM,TO or --law NAME"),
        (["--period", "fast"], "'fast' is no period; give hours, or a number with s, min, h or d"),
        (["--period-range", "5"], "--period-range is '5'; give FROM,TO"),
        (["--period", "5", "--period-range", "4,6"], "give the sidereal period with --period"),
        (["--period", "5", "--n-poles", "0"], "--n-poles is 0; expected a whole number from 1"),
        (["--period", "5", "--reflectance", "chalk"], "unknown law of reflection 'chalk'"),
        (["--law", "hovering"], "unknown attitude law 'hovering'; available: inertial"),
        (["--law", "lvlh"], "the law 'lvlh' needs the satellite's orbit"),
        (["--period", "5", "--scheduler", "tcp://127.0.0.1:9", "--workers", "2"], "both given"),
        (["--period", "5", "--workers", "0"], "--workers is 0; expected a whole number >= 1"),
    ],
)
def test_faults_are_one_line(asteroid, tmp_path, capsys, options, message):
    folder, out = asteroid[0], tmp_path / "out"
    argv = ["scan", str(folder / "asteroid.csv"), "-o", str(out), *options]
    assert_refused(argv, out, message, capsys)


def test_starting_from_what_is_no_scan_is_refused(asteroid, tmp_path, capsys):
    folder, _, _ = asteroid
    fit = ["fit", str(folder / "asteroid.csv"), "--model", "convex-grid", "-o", str(tmp_path / "x")]
    assert main.main([*fit, "--start-from", str(tmp_path)]) == EXIT_BAD_INPUT
    assert "holds no scan" in capsys.readouterr().err
    lcbayes.write(spinning_bodies.geometry(2, 5), tmp_path / "other.csv")
    fit[1] = str(tmp_path / "other.csv")
    assert main.main([*fit, "--start-from", str(folder / "out")]) == EXIT_BAD_INPUT
    assert "is of another light curve" in capsys.readouterr().err


def test_the_folder_of_a_fit_is_left_alone(asteroid, tmp_path, capsys):
    (tmp_path / "run.toml").write_text('schema = 4\ntask = "fit"\n')
    write_json({"model": "faceted"}, tmp_path / "summary.json")
    _, argv, _ = asteroid
    assert main.main([*argv, "-o", str(tmp_path)]) == EXIT_BAD_INPUT
    assert "holds results of lcbayes fit; choose another" in capsys.readouterr().err
    assert json.loads((tmp_path / "summary.json").read_text()) == {"model": "faceted"}


def test_a_scan_is_loaded_and_reported_again_from_its_folder_alone(asteroid, tmp_path):
    """Every array that a page draws comes back, and so does the page."""
    folder = shutil.copytree(asteroid[0] / "out", tmp_path / "elsewhere")
    result = lcbayes.load(folder)
    assert isinstance(result, lcbayes.Scan)
    page = (folder / "report.html").read_text()
    drawn = {p.name: p.read_bytes() for p in (folder / "figures").iterdir()}
    (folder / "report.html").unlink()
    shutil.rmtree(folder / "figures")
    assert main.main(["report", str(folder)]) == EXIT_DONE
    assert (folder / "report.html").read_text() == page
    assert {p.name: p.read_bytes() for p in (folder / "figures").iterdir()} == drawn
    table = result.summary()
    assert float(table["sidereal_period_h"].iloc[0]) == result.solutions[0].get("period_h")
    for draw in (result.plot_sky, result.plot_periods, result.plot_light_curve, result.plot_body):
        assert len(draw()) == 1
