import json
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from scipy.stats import norm

import lcbayes
from lcbayes.analysis import (
    contents,
    diagnostics_plots,
    light_curve_plots,
    quantities,
    tables,
)
from lcbayes.analysis.numerals import duration, show
from lcbayes.cli.main import main
from lcbayes.core.errors import InputError
from lcbayes.geometry.times import date
from tests.helpers import results_folders


class Page(HTMLParser):
    """The text of a page, its images, and every address that a browser would fetch."""

    def __init__(self, html: str):
        super().__init__()
        self.words: list[str] = []
        self.images: list[dict[str, str]] = []
        self.addresses: list[str] = []
        self.feed(html)
        self.text = re.sub(r"\s+", " ", " ".join(self.words))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        result = {k: v or "" for k, v in attrs}
        self.addresses += [v for k, v in result.items() if k in ("src", "href", "srcset", "action")]
        if tag == "img":
            self.images.append(result)

    def handle_data(self, data: str) -> None:
        self.words.append(data)


@pytest.fixture(scope="module")
def faceted(tmp_path_factory) -> Path:
    folder = results_folders.faceted(tmp_path_factory.mktemp("faceted"))
    lcbayes.report(folder)
    return folder


@pytest.fixture(scope="module")
def asteroid(tmp_path_factory) -> Path:
    folder = results_folders.asteroid(
        tmp_path_factory.mktemp("asteroid"), n_facets=80, n_curves=14, dark=True
    )
    lcbayes.report(folder)
    return folder


def page(folder: Path) -> Page:
    return Page((folder / "report.html").read_text(encoding="utf-8"))


def test_page_is_one_file_with_described_images(faceted):
    result = page(faceted)
    assert result.addresses
    assert all(a.startswith("data:") for a in result.addresses)
    assert len(result.images) >= 12
    assert all(len(i["alt"]) > 10 for i in result.images)
    assert "url(" not in (faceted / "report.html").read_text(encoding="utf-8")


def test_same_results_give_the_same_page_and_leave_nothing_behind(faceted, tmp_path, capsys):
    """By the command, which prints where the page is."""
    copy = shutil.copytree(faceted, tmp_path / "copy")
    (copy / "shape.obj").write_text("stale")
    before = (copy / "report.html").read_bytes()
    (copy / "report.html").unlink()
    assert main(["report", str(copy)]) == 0
    assert capsys.readouterr().out == f"{copy / 'report.html'}\n"
    assert (copy / "report.html").read_bytes() == before
    assert {p.name for p in copy.iterdir()} == {
        "posterior.nc",
        "summary.json",
        "run.toml",
        "report.html",
        "figures",
        ".lock",
    }
    assert {p.suffix for p in (copy / "figures").iterdir()} == {".svg", ".pdf"}
    pdf = [p.read_bytes() for p in (copy / "figures").glob("*.pdf")]
    assert not any(b"/Type3" in file for file in pdf)  # journals refuse such fonts


def test_sections_come_in_order(faceted):
    text = page(faceted).text
    heads = [
        "pass.csv",
        "2 solutions explain the data",
        "Key results",
        "What was observed",
        "What was assumed",
        "turns at a constant angular velocity",
        "Light curve",
        "Shape",
        "Facets on the body",
        "Spin axis on the sky",
        "Parameters",
        "R-hat",
        "Can it be trusted?",
        "lcbayes fit --config run.toml",
    ]
    place = 0
    for head in heads:
        place = text.index(head, place)  # fails where it is not, or comes too early


def test_solutions_are_side_by_side_and_not_averaged(faceted):
    tree = xr.open_datatree(faceted / "posterior.nc", engine="h5netcdf")
    results = contents.read(faceted)
    table = tables.key_table(results, results.modes)
    for k in range(2):
        g = tree[f"modes/{k}/posterior/g"].to_numpy()[..., 1]
        facets = tables.facet_table(results, results.modes[k])
        assert facets is not None
        polar = float(facets["rows"][1]["angles"][1])
        assert polar == pytest.approx(np.degrees(np.arccos(g)).mean(), abs=0.1)
    tree.close()
    assert [name for name, _ in table["heads"]] == ["Solution 1", "Solution 2"]
    assert "62 %" in page(faceted).text


def test_every_phase_law_is_in_the_short_table(asteroid):
    results = contents.read(asteroid)
    mode = results.modes[0]
    curves = {"phase_law": ["curve 7", "curve 8"]}
    two = mode.draws["phase_k"] + xr.DataArray([0.0, 0.3], curves)
    twice = replace(mode, draws=mode.draws.assign(phase_k=two))
    rows = tables.key_table(results, [twice])["rows"]
    shown = {r["name"]: r["cells"][0][0] for r in rows if "slope k" in r["name"]}
    assert list(shown) == ["phase law: slope k, curve 7", "phase law: slope k, curve 8"]
    means = [float(mean.replace("−", "-")) for mean in shown.values()]
    np.testing.assert_allclose(means, [-0.5, -0.2], atol=0.01)


def test_unknown_parameters_are_listed_and_angles_do_not_wrap(faceted):
    text = page(faceted).text
    assert "glitter" in text
    assert "omega_x_rad_s" in text
    assert "omega_unit" not in text
    results = contents.read(faceted)
    rows = {q.name: q for q in quantities.quantities(results, results.modes[0])}
    assert rows["phi[0]"].mean == pytest.approx(0.1, abs=0.01)  # some draws are below zero
    assert rows["phi[0]"].sd < 0.1


HOSTILE = "<script>alert(1)</script>.csv"


@pytest.fixture(scope="module")
def not_converged(tmp_path_factory) -> Path:
    """A fit of magnitudes that did not converge, of a file whose name is code."""
    folder = tmp_path_factory.mktemp("bad")
    results_folders.faceted(folder, bad=True, kind="mag", title=HOSTILE.replace("/", "\\"))
    lcbayes.report(folder)
    return folder


def test_run_that_did_not_converge_says_so_first_and_why(not_converged):
    text = page(not_converged).text
    said = text.index("Do not trust these numbers")
    assert said < text.index("R-hat of albedo_area[0] is 2.31") < text.index("Key results")
    assert "explain the data" not in text
    assert "Black crosses are divergent draws" in text


def test_magnitudes_and_hostile_names(not_converged):
    html = (not_converged / "report.html").read_text(encoding="utf-8")
    assert "<script>alert" not in html
    assert "&lt;script&gt;alert(1)" in html
    assert "apparent magnitudes" in page(not_converged).text


def test_asteroid_gets_a_body_and_both_poles(asteroid):
    lines = (asteroid / "shape.obj").read_text().splitlines()
    vertices = np.array([x.split()[1:] for x in lines if x.startswith("v ")], float)
    extent = np.ptp(vertices, axis=0)
    assert extent / extent[2] == pytest.approx([1.5 / 0.9, 1.1 / 0.9, 1.0], rel=0.1)
    assert (asteroid / "shape-2.obj").exists()
    text = page(asteroid).text
    for words in ("253.", "70.", "5.761980", "ecliptic J2000", "dark in every draw", "300 values"):
        assert (words in text) == (words != "300 values")
    assert "The 12 most informative of 14 segments" in text
    assert "The convex body" in text
    assert "log_sigma" not in text
    assert "expected[" not in text


def test_folder_without_solutions_apart(faceted, tmp_path):
    with xr.open_datatree(faceted / "posterior.nc", engine="h5netcdf") as tree:
        tree.load()
        groups = {p: g.to_dataset() for p, g in tree.subtree_with_keys if "modes" not in p}
        first = groups["posterior"]["solution"] == 0
        groups["posterior"] = (
            groups["posterior"].isel(chain=first).drop_vars(["solution", "weight"])
        )
        groups["posterior_predictive"] = groups["posterior_predictive"].isel(chain=first)
        groups["sample_stats"] = tree["modes/0/sample_stats"].to_dataset()
        groups = {k: v for k, v in groups.items() if k not in ("log_likelihood", "prior")}
        groups["."].attrs = dict(tree.attrs)
    xr.DataTree.from_dict(groups).to_netcdf(tmp_path / "posterior.nc", engine="h5netcdf")
    verdict = {"schema": 4, "task": "fit", "trusted": True, "reasons": []}
    (tmp_path / "summary.json").write_text(json.dumps(verdict))
    shutil.copy(faceted / "run.toml", tmp_path)
    lcbayes.report(tmp_path)
    text = page(tmp_path).text
    assert "One solution fits the data" in text  # its misfit is not known
    assert "Solution 2" not in text


@pytest.mark.parametrize(
    ("break_it", "message"),
    [
        (lambda d: (d / "posterior.nc").unlink(), "holds no posterior.nc; give the folder"),
        (lambda d: (d / "posterior.nc").write_bytes(b"nothing"), "cannot be read"),
        (lambda d: (d / "summary.json").unlink(), "summary.json is missing"),
        (lambda d: (d / "summary.json").write_text("{\n "), "line 2"),
        (lambda d: (d / "summary.json").write_text("[1, 2]"), "is no JSON object"),
        (lambda d: (d / "summary.json").write_text('{"modes": 3}'), "modes is not a list"),
        (
            lambda d: (d / "summary.json").write_text('{"modes": [3]}'),
            "summary.json is not of this",
        ),
        (lambda d: (d / "summary.json").write_bytes(b"\xff{}"), "cannot be read"),
    ],
)
def test_damaged_folders_are_named_in_one_line(faceted, tmp_path, break_it, message):
    folder = shutil.copytree(faceted, tmp_path / "d")
    before = (folder / "report.html").read_bytes()
    break_it(folder)
    with pytest.raises(InputError, match=message) as fault:
        lcbayes.report(folder)
    assert "\n" not in str(fault.value)
    assert (folder / "report.html").read_bytes() == before


def test_figures_are_given_to_python(faceted):
    fit = lcbayes.load(faceted)
    assert isinstance(fit, lcbayes.Fit)
    for draw in (fit.plot_light_curve, fit.plot_parameters, fit.plot_sky, fit.plot_trace):
        figures = draw()
        assert figures
        assert all(figure.axes for figure in figures)


def test_options_are_imported_without_the_heavy_libraries():
    code = "import sys, lcbayes.cli.main as m; m._parser(); print(*sys.modules)"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not {"matplotlib", "jax", "arviz", "xarray", "numpy"} & set(out.stdout.split())


@pytest.mark.parametrize(
    ("value", "spread", "text"),
    [
        (5.7619801234, 4.1e-6, "5.7619801"),
        (253.2412, 0.79, "253.24"),
        (-17.2, 1.3, "−17.2"),
        (123456.7, 2300, "123500"),
        (0.00012345, 0.000031, "1.23×10⁻⁴"),
        (3.2e9, 1e8, "3.20×10⁹"),
        (-1e-12, 0.03, "0.000"),
        (0.0, float("nan"), "0.00"),
        (float("nan"), 1.0, "–"),
        (None, 1.0, "–"),
        (2.0, float("nan"), "2.000"),
    ],
)
def test_uncertainty_decides_the_digits(value, spread, text):
    assert show(value, spread) == text


def test_dates_and_durations():
    assert date(2451545.0, clock=True) == "2000-01-01 12:00"
    assert date(2440587.5) == "1970-01-01"
    assert duration(90.0) == "90 s"
    assert duration(5700.0) == "95 minutes"
    assert duration(25 * 365.25 * 86400) == "25 years"


def test_passes_are_distinguished_and_lone_points_are_not():
    def split(t, curve):
        results = SimpleNamespace(t=np.asarray(t, float), curve=np.asarray(curve), labels={})
        return [list(s.points) for s in light_curve_plots.segments(results)]  # pyright: ignore[reportArgumentType]

    two = [*range(0, 60, 5), *range(9000, 9060, 5)]
    assert [len(p) for p in split(two, [0] * 24)] == [12, 12]
    assert [len(p) for p in split(two, [0] * 12 + [1] * 12)] == [12, 12]
    nights = np.arange(10) * 86400.0
    assert [len(p) for p in split(nights, [0] * 10)] == [10]


@pytest.mark.parametrize(("power", "n"), [(1.0, 40), (0.2, 12)])
def test_loo_pit_of_a_normal_mean_is_the_exact_one(power, n):
    """Also where the draws come from a likelihood raised to a power, as residuals warrant."""
    rng = np.random.default_rng(11)
    sd, chains, draws = 0.7, 4, 1000
    y = 3.0 + sd * rng.normal(size=n)
    mu = y.mean() + sd / np.sqrt(power * n) * rng.normal(size=(chains, draws))
    dims = ("chain", "draw", "time")
    predicted = mu[..., None] + sd * rng.normal(size=(chains, draws, n))
    log_lik = norm.logpdf(y, mu[..., None], sd)
    log_lik[..., 0] = -1.0  # an epoch at which no draw matters
    log_lik[..., 1] = np.where(rng.random((chains, draws)) < 0.5, -1.0, -1.5)  # two values only
    results = SimpleNamespace(
        brightness=y,
        log_likelihood=xr.DataArray(log_lik, dims=dims),
        predicted=xr.DataArray(predicted, dims=dims),
        summary={"fit": {"information_per_point": power}},
    )
    pit = diagnostics_plots.loo_pit(results)  # pyright: ignore[reportArgumentType]
    assert pit is not None
    assert pit.dark == 1
    without = (y.sum() - y) / (n - 1)
    exact = norm.cdf(y, without, sd * np.sqrt(1 + 1 / (power * (n - 1))))
    assert pit.values[2:] == pytest.approx(exact[2:], abs=0.04)
    plain = np.mean(predicted[..., :2] < y[:2], axis=(0, 1))
    assert pit.values[:2] == pytest.approx(plain, abs=0.02)


@pytest.mark.parametrize(("chains", "draws"), [pytest.param(1, 2, marks=pytest.mark.slow), (2, 12)])
def test_very_short_runs_still_get_a_page(faceted, tmp_path, chains, draws):
    with xr.open_datatree(faceted / "posterior.nc", engine="h5netcdf") as tree:
        groups = {
            path: group.to_dataset().isel(
                {d: slice(n) for d, n in (("chain", chains), ("draw", draws)) if d in group.dims}
            )
            for path, group in tree.subtree_with_keys
        }
        groups["."].attrs = dict(tree.attrs)
        short = xr.DataTree.from_dict(groups)
        short.to_netcdf(tmp_path / "posterior.nc", engine="h5netcdf")
    for name in ("summary.json", "run.toml"):
        shutil.copy(faceted / name, tmp_path)
    lcbayes.report(tmp_path)
    assert "Key results" in page(tmp_path).text
