"""`lcbayes predict` for asteroids: outlines over chords and rotation at dates."""

from __future__ import annotations

import csv
import json
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

import lcbayes
from lcbayes.cli.main import main
from lcbayes.core.errors import EXIT_BAD_INPUT, EXIT_DONE, EXIT_NOT_TRUSTED
from lcbayes.results.asteroid import asteroids
from lcbayes.tasks.predict import outline
from tests.helpers import occulting_ellipsoid as known
from tests.helpers.results_folders import figures

DIAMETER = 2.0 * np.cbrt(np.prod(known.AXES))


@pytest.fixture(scope="module")
def predicted(tmp_path_factory):
    """The folder of a fit, a file of chords, and the folder of the outlines."""
    path = tmp_path_factory.mktemp("outline")
    fit = known.folder(path / "fit", known.posterior())
    rng = np.random.default_rng(1)
    one = known.event(np.linspace(-31.0, 33.0, 9), rng=rng, negative=(-48.0,))
    (path / "chords.occ").write_text(known.text([one]))
    argv = ["predict", str(fit), "--occultation", str(path / "chords.occ"), "--num-bodies", "24"]
    return fit, path, main([*argv, "-o", str(path / "out")])


def test_outline_diameter_and_pole(predicted):
    _, path, status = predicted
    estimate = json.loads((path / "out" / "summary.json").read_text())
    right, wrong = estimate["solutions"]
    assert estimate["events"][0]["n_chords"] == 9
    assert estimate["events"][0]["n_negative"] == 1
    # the chords are of the first pole
    assert right["weight_before"] == wrong["weight_before"] == 0.5
    assert right["share_inside_90"] > 0.7
    assert right["ends_inside_90_without_relief"] <= right["ends_inside_90"]
    assert right["rms_distance_km"] < 0.5 * wrong["rms_distance_km"]
    assert abs(right["diameter_from_light_curves_km"]["mean"] - DIAMETER) < 0.02 * DIAMETER
    assert right["negative_chords_crossed"] == 0.0
    # a few of 24 draws fit chords to 0.1 km best: an effective number that is refused
    assert right["effective_bodies"] < outline.MIN_EFFECTIVE
    assert status == EXIT_NOT_TRUSTED
    assert [r["code"] for r in estimate["reasons"]] == ["chords-choose-few-bodies"]
    assert estimate["diameter_km"] is None
    assert right["weight"] is None


def test_files_of_an_outline(predicted):
    _, path, _ = predicted
    out = path / "out"
    assert figures(out) == {"outlines-1-column", "outlines-2-columns"}
    svg = (out / "figures" / "outlines-1-column.svg").read_text()
    assert f'width="{88 / 25.4 * 72:.1f}'[:9] in svg
    with (out / "tables" / "ends.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 2 * 18
    inside = [r["inside_90"] == "True" for r in rows[:18]]
    summary = json.loads((out / "summary.json").read_text())
    assert sum(inside) == summary["solutions"][0]["ends_inside_90"]
    with (out / "tables" / "outlines.csv").open() as file:
        bands = list(csv.DictReader(file))
    assert len(bands) == 2 * outline.ANGLES
    assert all(float(r["q05_km"]) <= float(r["q50_km"]) <= float(r["q95_km"]) for r in bands)
    limb = [float(r["limb_q95_km"]) - float(r["limb_q05_km"]) for r in bands]
    convex = [float(r["q95_km"]) - float(r["q05_km"]) for r in bands]
    assert np.all(np.array(limb) > convex)
    assert "rms distance" in (out / "report.html").read_text()


def test_radius_from_the_support_function():
    """A disc beside the origin: r = d cos φ + √(R² − d² sin² φ)."""
    angle = 2.0 * np.pi * np.arange(360) / 360
    height = 10.0 + 3.0 * np.cos(angle)
    for toward in (0.0, 1.0, 2.5, np.pi):
        estimate = outline.radius(height[None], angle, toward)[0]
        expected = 3.0 * np.cos(toward) + np.sqrt(100.0 - 9.0 * np.sin(toward) ** 2)
        assert estimate == pytest.approx(expected, rel=1e-3)


def test_the_band_of_the_limb_holds_the_heights_of_its_prior():
    """Ends at every quantile of heights over a ball of 40 km: rms 3 % of the radius times e^±1."""

    def below(height: float) -> float:
        given = lambda u: norm.pdf(u) * norm.cdf(height / (0.03 * 40.0 * np.exp(u)))  # noqa: E731
        return quad(given, -8.0, 8.0)[0]

    heights = np.linspace(-12.0, 12.0, 241)
    share = np.array([below(float(h)) for h in heights])
    bodies = 4000
    placed = SimpleNamespace(
        size=np.full(bodies, 80.0), distance=np.broadcast_to(heights, (bodies, len(heights)))
    )
    ball = outline.Outline(
        asteroid=cast(Any, None),
        n_failed=0,
        placed=cast(Any, placed),
        outline=np.full((bodies, 1, 36), 0.5),  # of the diameter
        chords=cast(Any, SimpleNamespace(along_km=np.zeros((len(heights), 2)))),
        posterior=1.0,
        joint=np.full(bodies, 1.0 / bodies),
        effective=float(bodies),
    )
    inside = ball.inside(relief=True)
    sure = np.abs(np.minimum(share, 1.0 - share) - 0.05) > 5.0 * np.sqrt(0.05 * 0.95 / bodies)
    assert sure.sum() > 150
    np.testing.assert_array_equal(inside[sure], (share[sure] > 0.05) & (share[sure] < 0.95))
    np.testing.assert_array_equal(ball.inside(relief=False), heights == 0.0)


def test_chords_choose_the_pole_where_shapes_are_uncertain(tmp_path):
    """Coarse timing leaves many bodies; the weight moves to the pole of the chords."""
    tree = known.posterior(draws=40, scatter=0.03)
    one = known.event(np.linspace(-31.0, 33.0, 5), error_s=1.0, rng=np.random.default_rng(3))
    (tmp_path / "chords.occ").write_text(known.text([one]))
    fit = known.folder(tmp_path / "fit", tree)
    result = lcbayes.predict(fit, occultation=tmp_path / "chords.occ", num_bodies=40)
    content: Any = result.content
    assert content["solutions"][0]["weight"] > 0.9
    assert result.trusted
    diameter = content["diameter_km"]
    assert abs(diameter["mean"] - DIAMETER) < 4.0 * diameter["sd"]
    assert diameter["sd"] < 0.05 * DIAMETER
    assert content["solutions"][0]["effective_bodies"] >= outline.MIN_EFFECTIVE


def test_rotation_at_dates(predicted, tmp_path, capsys):
    fit, _, _ = predicted
    later = known.MIDDLE_JD + 9000.0
    argv = ["predict", str(fit), "--date", str(known.MIDDLE_JD), "--date", str(later)]
    assert main([*argv, "-o", str(tmp_path / "r.csv")]) == EXIT_DONE
    with (tmp_path / "r.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [r["solution"] for r in rows] == ["1", "1", "2", "2"]
    one = asteroids(known.posterior())[0]
    angles = one.rotation_angle_deg([known.MIDDLE_JD, later])
    for row, angle in zip(rows, angles.T, strict=False):
        assert float(row["rotation_deg"]) == pytest.approx(angle.mean() % 360.0, abs=1e-6)
        assert float(row["rotation_sd_deg"]) == pytest.approx(angle.std(ddof=1), rel=1e-6)
    assert "solution 2 (weight 0.5)" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ([], "give one of: a file with epochs and geometry, --date JD, --occultation FILE"),
        (["a.csv", "--date", "2450000.5"], "give one of"),
        (["--date", "soon"], "--date is 'soon'; expected a number"),
        (["--occultation", "missing.occ"], "missing.occ does not exist"),
    ],
)
def test_bad_requests(predicted, tmp_path, capsys, words, says):
    fit, _, _ = predicted
    assert main(["predict", str(fit), *words, "-o", str(tmp_path / "x")]) == EXIT_BAD_INPUT
    error = capsys.readouterr().err
    assert says in error
    assert error.count("\n") == 1
    assert not (tmp_path / "x").exists()


def test_a_fit_of_something_else(predicted, tmp_path, capsys):
    _, path, _ = predicted
    tree = known.posterior(draws=4)
    tree.attrs["frame"] = "icrs"
    fit = known.folder(tmp_path / "icrs", tree)
    argv = ["--occultation", str(path / "chords.occ"), "-o", str(tmp_path / "x")]
    assert main(["predict", str(fit), *argv]) == EXIT_BAD_INPUT
    assert "the fit is in the frame icrs" in capsys.readouterr().err
    del tree.attrs["epoch_jd"]
    fit = known.folder(tmp_path / "seconds", tree)
    assert main(["predict", str(fit), *argv]) == EXIT_BAD_INPUT
    assert "give a fit of the model convex-grid" in capsys.readouterr().err


def test_the_figure_of_the_page_is_made(predicted, tmp_path, capsys):
    from docs import make_asteroid_size

    fit, path, _ = predicted
    make_asteroid_size.main(fit, path / "chords.occ", tmp_path / "a.svg", num_bodies=20)
    assert (tmp_path / "a.svg").read_text().count("<path") > 40
    assert "effective number of bodies" in capsys.readouterr().out
