"""A body of known shape, from its file to its motion and to a prediction."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import lcbayes
from lcbayes.cli.main import main
from lcbayes.data.lightcurve import LightCurve
from lcbayes.data.write import write
from tests.helpers import turning_bodies as turning

BRICK = """
title = "a brick"
[body]
shadows = false
[[body.parts]]
kind = "box"
x = 1.0
y = 2.0
z = 3.0
[materials.paint]
law = "lambertian"
r_diff = { low = 0.1, high = 0.9 }
"""
ATTITUDE = Rotation.from_rotvec([0.7, -1.1, 0.4]).as_matrix()
OMEGA = 0.06 * ATTITUDE @ [1.0, 0.0, 0.0]  # the shortest side


def light_curve(first: int, count: int, snr: float = 40.0) -> LightCurve:
    """Some of four passes of a brick in a flat spin."""
    t, sun, obs = turning.geometry((0.0, 900.0, 2100.0, 3300.0), 40, 200.0)
    rows = slice(40 * first, 40 * (first + count))
    flux = turning.box(*turning.in_body(t, ATTITUDE, OMEGA, sun, obs), (1, 2, 3), 0.4)
    error = np.full(t.size, flux.mean() / snr)
    noisy = flux + error * np.random.default_rng(8).standard_normal(t.size)
    return LightCurve(
        t=t[rows],
        brightness=noisy[rows],
        error=error[rows],
        sun=sun[rows],
        obs=obs[rows],
        frame="icrs",
        kind="flux",
        free_scale=np.array([False]),
        epoch_jd=2461000.5,
    )


@pytest.mark.slow
def test_motion_of_a_brick(tmp_path: Path, capsys):
    write(light_curve(0, 3), tmp_path / "passes.csv")
    write(light_curve(3, 1), tmp_path / "next.csv")
    body, out = tmp_path / "brick.toml", tmp_path / "out"
    body.write_text(BRICK)
    status = main(
        [
            "fit",
            str(tmp_path / "passes.csv"),
            "-o",
            str(out),
            "--model",
            "body",
            "--body",
            str(body),
            "--set",
            "omega_sd=0.03",
            "--num-warmup",
            "100",
            "--num-samples",
            "150",
            "--num-chains",
            "2",
            "--max-modes",
            "2",
            "--seed",
            "1",
        ]
    )
    said = capsys.readouterr().out
    assert status in (0, 3)  # 300 draws are too few to be trusted
    result = lcbayes.load(out)
    draws = result.data["modes/0/posterior"].to_dataset()
    omega = draws["omega"].values.reshape(-1, 3)
    apart = (omega.mean(axis=0) - OMEGA) / omega.std(axis=0)
    assert np.abs(apart).max() < 5.0
    attitude = draws["attitude"].values.reshape(-1, 3, 3)
    images = [
        ATTITUDE @ g for g in (np.eye(3), *map(np.diag, ([1, -1, -1], [-1, 1, -1], [-1, -1, 1])))
    ]
    assert min(np.abs(attitude.mean(axis=0) - image).max() for image in images) < 0.1
    assert "cells of pole and rate" in said
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "a brick" in page
    assert '"solids": [{' in page.replace('":[', '": [')  # the body turns beside the light curve

    body.unlink()  # a results folder needs no other file
    assert main(
        ["predict", str(out), str(tmp_path / "next.csv"), "-o", str(tmp_path / "p.csv")]
    ) in (0, 3)
    predicted = np.genfromtxt(tmp_path / "p.csv", delimiter=",", names=True)
    true = light_curve(3, 1)
    assert true.error is not None
    assert np.std(predicted["flux_mean"] - true.brightness) < 2.0 * true.error[0]
