"""A fit of an asteroid: dimensions, exports and figures, and predictions from its folder."""

from __future__ import annotations

import csv
import json
from dataclasses import replace

import numpy as np
import pytest

import lcbayes
from lcbayes.results.asteroid import QUANTITIES
from tests.helpers import damit_model, spinning_bodies
from tests.helpers.results_folders import figures

POLE, PERIOD = np.array([0.48, -0.6, 0.64]), 5.0


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """A short fit of a small simulated asteroid, with its folder."""
    folder = tmp_path_factory.mktemp("asteroid")
    curve = spinning_bodies.observed(
        spinning_bodies.geometry(6, 12, days=60.0), POLE, PERIOD, 0.003, 100
    )
    curve = replace(curve, epoch_jd=2450000.5)
    options = {"n_facets": 100, "degree": 3, "period": PERIOD, "model": "convex-grid"}
    short = {"num_warmup": 30, "num_samples": 20, "num_chains": 2, "num_starts": 16}
    result = lcbayes.fit(curve, **options, **short, max_modes=1, out=folder / "out")
    return curve, result, folder


@pytest.mark.slow
def test_dimensions_model_curves_and_exports(fitted):
    curve, result, folder = fitted
    out = folder / "out"
    body = json.loads((out / "summary.json").read_text())["modes"][0]["body"]
    assert set(body["quantities"]) == set(QUANTITIES)
    assert body["n_bodies"] + body["n_failed"] == 40
    text = result.text()
    assert "extent_ab" in text
    assert "inertia_tilt_deg" in text
    with (out / "tables" / "dimensions.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [r["quantity"] for r in rows] == list(QUANTITIES)
    assert float(rows[0]["mean"]) == pytest.approx(body["quantities"]["extent_a"]["mean"])
    assert "volume-equivalent diameter" in rows[0]["definition"]
    with (out / "tables" / "model_curves.csv").open() as file:
        curves = list(csv.DictReader(file))
    assert len(curves) == curve.n_obs
    assert {"model-curves-1-1-column", "model-curves-1-2-columns"} <= figures(out)
    widths = [figure.get_size_inches()[0] * 25.4 for figure in result.plot_model_curves()]
    assert widths == pytest.approx([88.0, 180.0])
    for suffix in ("obj", "stl", "txt"):
        assert (out / f"shape.{suffix}").is_file()
    # the exported triangles give the model curve, up to the spread of few draws
    model = damit_model.read(out)
    jd = np.array([float(r["jd"]) for r in curves])
    np.testing.assert_allclose(jd, curve.epoch_jd + curve.t / 86400.0, atol=1e-8)
    flux = model.flux(jd, curve.sun, curve.obs)
    model_flux = np.array([float(r["model"]) for r in curves])
    count = np.bincount(curve.curve)
    flux, model_flux = (
        x / (np.bincount(curve.curve, x) / count)[curve.curve] for x in (flux, model_flux)
    )
    assert np.sqrt(np.mean((flux - model_flux) ** 2)) < 0.01
    assert np.std(model_flux) > 0.05
    phase = np.array([float(r["rotation"]) for r in curves])
    turned = np.mod((jd - model.jd0) * 24.0 / model.period_h + model.phi0 / 360.0, 1.0)
    np.testing.assert_allclose(np.mod(phase - turned + 0.5, 1.0), 0.5, atol=1e-5)


@pytest.mark.slow
def test_predictions_for_a_damit_file_and_for_dates(fitted):
    """The file of light curves in DAMIT's format is accepted; so are dates."""
    curve, _, folder = fitted
    rows = [str(curve.n_curves)]
    for c in range(curve.n_curves):
        here = np.flatnonzero(curve.curve == c)
        rows.append(f"{len(here)} 0")
        for i in here:
            cells = [curve.epoch_jd + curve.t[i] / 86400.0, curve.brightness[i]]
            rows.append(" ".join(f"{x:.9f}" for x in (*cells, *curve.sun[i], *curve.obs[i])))
    (folder / "later.lcs").write_text("\n".join(rows) + "\n")
    predicted = lcbayes.predict(folder / "out", folder / "later.lcs").summary()
    model_flux = predicted["flux_mean"].to_numpy()
    mean = np.bincount(curve.curve, curve.brightness) / np.bincount(curve.curve)
    observed = curve.brightness / mean[curve.curve]
    assert np.sqrt(np.mean((model_flux / model_flux.mean() - observed) ** 2)) < 0.05
    dates = lcbayes.predict(folder / "out", date=(2450010.5, 2450020.5)).summary()
    assert len(dates) == 2
    spin = damit_model.read(folder / "out")
    turns = (dates["jd"] - spin.jd0) * 24.0 / spin.period_h
    expected = np.mod(spin.phi0 + 360.0 * turns, 360.0)
    apart = np.mod(dates["rotation_deg"] - expected + 180.0, 360.0) - 180.0
    assert np.all(np.abs(apart) < 3.0 * dates["rotation_sd_deg"] + 2.0)
