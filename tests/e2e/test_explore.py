"""The report that one can question, in a real browser: what each control does."""

from __future__ import annotations

import base64
import csv
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from scipy.spatial.transform import Rotation

import lcbayes
from lcbayes.analysis import contents
from lcbayes.core.constants import HOUR_S
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.geometry.spherical import unit_vector
from lcbayes.physics.attitude import rotations
from lcbayes.physics.attitude.torque_free import torque_free_to_body
from tests.helpers import browser_pages, results_folders
from tests.helpers.opened_report import Opened, changed

CHART, BODY = "[data-is=chart] canvas", "[data-is=body] canvas"


class Folders(dict[str, Path]):
    """Results with a report by name, each made when it is first used."""

    def __init__(self, base: Path) -> None:
        self.base = base

    def __missing__(self, name: str) -> Path:
        if name == "satellite":
            folder = results_folders.faceted(self.base / name)
        else:
            folder = results_folders.asteroid(self.base / name, n_facets=60, n_curves=4)
        lcbayes.report(folder)
        self[name] = folder
        return folder


@pytest.fixture(scope="module")
def folders(tmp_path_factory) -> Folders:
    return Folders(tmp_path_factory.mktemp("explore"))


@pytest.fixture
def opened(browser, folders) -> Iterator[Any]:
    contexts = []

    def open_page(kind: str, **how: Any) -> Opened:
        context = browser.new_context(viewport=browser_pages.WIDE, accept_downloads=True, **how)
        contexts.append(context)
        pages.append(Opened(context.new_page(), folders[kind] / "report.html"))
        return pages[-1]

    pages: list[Opened] = []
    yield open_page
    for page in pages:
        assert page.faults == []
    for context in contexts:
        context.close()


def test_the_light_curve_zooms_pans_and_tells_its_points(opened):
    page = opened("satellite")
    whole = page.view(CHART)
    page.press("zoom-in")
    close = page.view(CHART)
    assert close[1] - close[0] == pytest.approx(0.6 * (whole[1] - whole[0]), rel=1e-4)
    page.tab.focus(CHART)
    page.tab.keyboard.press("ArrowRight")
    assert page.view(CHART)[0] > close[0]
    page.set("segment", 2)
    assert page.view(CHART)[0] > 280.0  # the second pass only
    box = page.box(CHART)
    page.tab.mouse.move(box["x"] + box["width"] / 2, box["y"] + 80)
    tooltip = page.tab.inner_text(".tip")
    assert "residual" in tooltip
    assert "UTC" in tooltip
    assert "phase angle" in tooltip
    page.press("reset")
    assert page.view(CHART) == whole


def test_it_folds_at_the_periods_of_the_posterior(opened, folders):
    page = opened("asteroid")
    period = contents.read(folders["asteroid"]).modes[0].draws["period_h"].to_numpy()
    page.press("fold")
    assert page.view(CHART) == pytest.approx([-0.02, 1.02])
    pictures = set()
    for value in (0, 500, 1000):
        page.set("period", value)
        shown = float(page.text("period-text").split()[0])
        margin = np.ptp(period)
        assert shown == pytest.approx(
            period.min() + (2e-3 * value - 0.5) * margin, abs=0.1 * margin
        )
        pictures.add(page.picture(CHART))
    page.set("multiple", 2)
    assert float(page.text("period-text").split()[0]) == pytest.approx(2 * period.mean(), rel=1e-4)
    assert len(pictures) == 3
    page.press("fold")
    assert page.view(CHART)[1] > 2.0


def test_satellites_fold_too(opened, folders):
    page = opened("satellite")
    omega = contents.read(folders["satellite"]).modes[0].draws["omega"].to_numpy()
    turn = 2 * np.pi / np.linalg.norm(omega, axis=-1).mean()
    page.press("fold")
    assert float(page.text("period-text").split()[0]) == pytest.approx(turn, rel=0.02)


def test_draws_have_their_curve_and_their_body(opened):
    page = opened("satellite")
    curve, body = page.picture(CHART), page.picture(BODY)
    page.set("draw", 7)
    assert page.text("draw-text") == "draw 8 of 40"
    assert page.picture(CHART) != curve
    assert page.picture(BODY) != body
    plain = page.picture(BODY)
    page.set("colours", "uncertainty")
    assert page.picture(BODY) != plain
    assert "standard deviation" in page.text("legend")
    page.set("mode", 1)
    assert page.text("draw-text") == "best of the draws"


@pytest.mark.parametrize("kind", ["satellite", "asteroid"])
def test_the_body_is_turned_as_the_model_turns_it(opened, folders, kind):
    page = opened(kind)
    results = contents.read(folders[kind])
    mode = results.modes[0]
    draws = {k: v.to_numpy()[0, 0] for k, v in mode.draws.items()}  # the first draw is shown first
    if kind == "satellite":
        rotation = rotations.constant_rate(jnp.asarray(results.t), jnp.asarray(draws["omega"]))
    else:
        pole = unit_vector(*np.radians([draws["pole_lon_deg"], draws["pole_lat_deg"]]))
        middle = 0.5 * (results.t[0] + results.t[-1])
        rotation = rotations.spinning(
            jnp.asarray(results.t - middle),
            rotations.brought_to(jnp.asarray(pole)),
            draws["period_h"] * HOUR_S,
        )
    seen = rotations.to_body(rotation, jnp.asarray(results.constant["obs"].to_numpy()))
    for index in (0, 10, results.t.size - 1):
        page.set("time", index)
        assert page.view(BODY)[:3] == pytest.approx(np.asarray(seen[index]), abs=2e-3)


def tumbling(node: xr.Dataset, rng: np.random.Generator) -> xr.Dataset:
    """The draws with an inertia tensor of each."""
    shape = (node.sizes["chain"], node.sizes["draw"])
    moments = np.sort(rng.uniform(0.6, 1.0, (*shape, 3)))[..., None] * np.eye(3)
    turn = np.linalg.qr(rng.standard_normal((*shape, 3, 3)))[0]
    tensor = turn @ moments @ np.swapaxes(turn, -1, -2)
    node["inertia"] = (("chain", "draw", "axis", "other_axis"), tensor)
    return node


def test_a_body_that_tumbles_is_turned_as_the_model_turns_it(opened, folders):
    folder = folders["tumbling"] = changed(folders["satellite"], "tumbling", tumbling)
    page = opened("tumbling")
    assert page.tab.locator("[data-is=fold]").is_disabled()  # there is no period
    results = contents.read(folder)
    draws = results.modes[0].draws.isel(chain=0, draw=0)
    tensor = jnp.asarray(draws["inertia"].to_numpy())
    vectors = (jnp.asarray(results.constant[k].to_numpy()) for k in ("sun", "obs"))
    omega = jnp.asarray(draws["omega"].to_numpy())
    _, seen = jax.jit(torque_free_to_body)(jnp.asarray(results.t), omega, tensor, *vectors)
    for index in (0, 10, results.t.size - 1):
        page.set("time", index)
        assert page.view(BODY)[:3] == pytest.approx(np.asarray(seen[index]), abs=2e-3)


L_SHAPE = """
title = "a box with a tower on one end"
[body]
shadows = true
[[body.parts]]
kind = "box"
x = 4.0
y = 2.0
z = 0.5
material = "floor"
[[body.parts]]
kind = "box"
x = 0.5
y = 2.0
z = 3.0
position = [-1.75, 0.0, 1.75]
material = "tower"
[materials.floor]
law = "lambertian"
r_diff = { low = 0.1, high = 0.9 }
[materials.tower]
law = "lambertian"
r_diff = 0.3
"""


@pytest.fixture(scope="module")
def known(folders) -> Path:
    """The satellite's folder, as if a known body with an unknown attitude and a drifting rate had
    been fitted."""

    def attitudes(node: xr.Dataset, rng: np.random.Generator) -> xr.Dataset:
        shape = (node.sizes["chain"], node.sizes["draw"])
        result = node[["omega"]]
        turns = Rotation.from_rotvec([0.7, -1.1, 0.4]) * Rotation.from_rotvec(
            0.01 * rng.standard_normal((np.prod(shape), 3))
        )
        matrices = turns.as_matrix().reshape(*shape, 3, 3)
        result["attitude"] = (("chain", "draw", "inertial", "body"), matrices)
        result["rate_drift"] = (("chain", "draw"), 0.02 + 0.001 * rng.standard_normal(shape))
        for material in ("floor", "tower"):
            areas = 3.0 * np.exp(0.1 * rng.standard_normal(shape))
            result[f"{material}_albedo_area"] = (("chain", "draw"), areas)
        return result

    options = {"body": L_SHAPE, "shadows": True}
    folders["known"] = changed(
        folders["satellite"], "known", attitudes, model="body", model_options=options
    )
    return folders["known"]


def test_a_known_body_is_turned_with_its_attitude_and_drift(opened, known):
    """By SciPy's rotations and the phase ω (t + ε [(t − t_m)² − t_m²]/2T) of a drifting rate."""
    page = opened("known")
    results = contents.read(known)
    draws = results.modes[0].draws.isel(chain=0, draw=0)
    omega, start = draws["omega"].to_numpy(), draws["attitude"].to_numpy()
    t, half = results.t, 0.5 * results.span_s
    even = t + float(draws["rate_drift"]) * ((t - half) ** 2 - half**2) / (4.0 * half)
    obs = results.constant["obs"].to_numpy()
    for index in (0, 10, 70, t.size - 1):
        turned = Rotation.from_rotvec(omega * even[index]) * Rotation.from_matrix(start)
        page.set("time", index)
        assert page.view(BODY)[:3] == pytest.approx(turned.inv().apply(obs[index]), abs=2e-3)
    page.set("colours", "uncertainty")
    assert "of a material" in page.text("legend")


@pytest.mark.usefixtures("known")
def test_a_known_body_shades_itself(opened):
    """Tiles of the floor are dark where the tower stands between them and the Sun."""
    page = opened("known")
    assert "in the shadow of another part" in page.tab.inner_text("#explore")
    packed = page.tab.evaluate("JSON.parse(document.getElementById('explored').textContent)")
    bodies = packed["modes"][0]["bodies"]
    assert bodies["names"] == ["floor", "tower"]
    shown = page.tab.evaluate(SHADED, [bodies, [-0.6, 0.0, 0.8]])
    centre = 17.0 / (22.0 + 17.0) * np.array([-1.75, 0.0, 1.75])  # of the areas of both boxes
    size = np.linalg.norm(np.array([2.0, 1.0, -0.25]) - centre)  # of the farthest corner
    tiles = [(np.array(m) * size + centre, n, dark) for m, n, dark in shown]
    floor = [(m, dark) for m, n, dark in tiles if n[2] > 0.9 and m[2] < 1 and m[0] > -1.5]
    assert len(floor) > 100
    length = (3.25 - 0.25) * 0.6 / 0.8  # of the shadow, from the tower's front at x = −1.5
    wrong = [m for m, dark in floor if dark != (m[0] < -1.5 + length)]
    assert not wrong
    assert sum(dark for _, dark in floor) > 30


# For each tile that faces the Sun: its middle, its normal, and whether a face is in the way.
SHADED = """([bodies, towards]) => {
  const sun = lcbayes.unit3(towards), read = (packed) => {
    const corners = lcbayes.numbers(packed.vertices, Int16Array);
    const sizes = lcbayes.numbers(packed.sizes, Uint8Array);
    let from = 0;
    return [...sizes].map((size) => {
      const made = Array.from({ length: size }, (_, i) =>
        [0, 1, 2].map((k) => corners[3 * (from + i) + k] / 32000));
      from += size;
      return lcbayes.face(made);
    });
  };
  const blocking = read(bodies.blocking[0]);
  return read(bodies.solids[0]).filter((tile) => lcbayes.dot3(tile.n, sun) > 0).map((tile) => {
    return [tile.middle, tile.n, lcbayes.inShadow(tile, blocking, sun)];
  });
}"""


LONG_CYLINDER = """
title = "a stage of unknown length"
[[body.parts]]
kind = "cylinder"
radius = 1.0
length = { low = 2.0, high = 9.0 }
material = "paint"
[materials.paint]
law = "lambertian"
r_diff = { low = 0.1, high = 0.9 }
"""


def test_each_draw_has_its_own_lengths(opened, folders):
    """The corners of a cylinder of radius 1 and length L are √(1 + L²/4) from its middle, to the
    thickness of the panels of its side; all draws have one scale."""

    def lengths(node: xr.Dataset, rng: np.random.Generator) -> xr.Dataset:
        shape = (node.sizes["chain"], node.sizes["draw"])
        result = node[["omega"]]
        result["attitude"] = (
            ("chain", "draw", "inertial", "body"),
            np.broadcast_to(np.eye(3), (*shape, 3, 3)),
        )
        length = ("chain", "draw"), rng.uniform(3.0, 8.0, shape)
        result["cylinder_length"] = length
        result["paint_albedo_area"] = (("chain", "draw"), np.ones(shape))
        return result

    body = {"body": LONG_CYLINDER, "shadows": False}
    folder = folders["cylinder"] = changed(
        folders["satellite"], "cylinder", lengths, model="body", model_options=body
    )
    page = opened("cylinder")
    packed = page.tab.evaluate("JSON.parse(document.getElementById('explored').textContent)")
    solids = packed["modes"][0]["bodies"]["solids"]
    assert len(solids) == packed["modes"][0]["draws"] > 10
    stored = contents.read(folder).modes[0]
    assert stored.curves is not None
    rows = np.linspace(0, stored.curves.sizes["curve_draw"] - 1, len(solids)).round().astype(int)
    chain, draw = (stored.curves[k].to_numpy()[rows] for k in ("chain_of", "draw_of"))
    length = stored.draws["cylinder_length"].to_numpy()[chain, draw]
    radius = np.sqrt(1.0 + length**2 / 4.0)
    shown = [
        np.linalg.norm(
            np.frombuffer(base64.b64decode(s["vertices"]), "<i2").reshape(-1, 3) / 32000, axis=1
        ).max()
        for s in solids
    ]
    assert shown == pytest.approx(radius / radius.max(), abs=3e-3)
    first = page.picture(BODY)
    page.set("draw", int(np.argmin(length)))
    assert page.picture(BODY) != first


def test_a_satellite_of_a_law_is_turned_by_it_and_its_array_apart(opened, folders):
    """A body that spins about z with a facet on one that does not; the axes by SciPy."""
    options = {"law": "constant-rate:x=0,y=0,z=0.02", "facets": "fixed:+x"}

    def facets(node: xr.Dataset, _: np.random.Generator) -> xr.Dataset:
        return node[["normals", "albedo_area"]]

    folders["law"] = changed(
        folders["satellite"], "law", facets, model="stabilised", model_options=options
    )
    page = opened("law")
    results = contents.read(folders["law"])
    obs = results.constant["obs"].to_numpy()
    turns = Rotation.from_rotvec(np.outer(results.t, [0.0, 0.0, 0.02])).inv()
    for index in (0, 10, results.t.size - 1):
        page.set("time", index)
        assert page.view(BODY)[:3] == pytest.approx(turns[index].apply(obs[index]), abs=2e-3)
    packed = page.tab.evaluate("JSON.parse(document.getElementById('explored').textContent)")
    (mobile,) = packed["modes"][0]["attitude"]["mobile"]
    assert mobile["facets"] == [0]
    axes = np.frombuffer(base64.b64decode(mobile["axes"]), "<i2").reshape(-1, 3, 3) / 32000
    np.testing.assert_allclose(axes, turns.as_matrix(), atol=1e-4)
    plain = page.picture(BODY)
    page.set("time", 3)
    assert page.picture(BODY) != plain


def test_it_plays_with_a_cursor_on_the_light_curve(opened):
    page = opened("satellite")
    page.set("speed", 4)
    start, body = page.tab.get_attribute(".cursor", "style"), page.view(BODY)
    page.press("play")
    at = "Number(document.querySelector('[data-is=time]').value)"
    for _ in range(200):
        page.tab.wait_for_timeout(50)
        if page.tab.evaluate(at) > 3:
            break
    assert page.tab.evaluate(at) > 3
    page.press("play")
    assert page.tab.get_attribute(".cursor", "style") != start
    assert page.view(BODY) != body
    stopped = page.view(BODY)
    page.tab.wait_for_timeout(100)
    assert page.view(BODY) == stopped
    box = page.box(CHART)
    page.tab.mouse.click(box["x"] + 0.7 * box["width"], box["y"] + 100)
    assert page.view(BODY) != stopped


def test_tables_sort_and_are_saved(opened, tmp_path):
    page = opened("satellite")
    table = page.tab.query_selector("table.parameters")
    table.query_selector("thead th:nth-child(4) button").click()
    cells = table.query_selector_all("tbody tr td:nth-child(4)")
    first = [cell.inner_text() for cell in cells]
    values = [float(x.replace("−", "-").replace("×10", "e").translate(_PLAIN)) for x in first]
    assert values == sorted(values)
    with page.tab.expect_download() as saving:
        page.tab.locator(".scroll:has(table.parameters) + .save").first.click()
    saving.value.save_as(tmp_path / "saved.csv")
    rows = list(csv.reader((tmp_path / "saved.csv").read_text().splitlines()))
    assert rows[0][:4] == ["name", "description", "unit", "mean"]
    assert [float(row[3]) for row in rows[1:]] == values


_PLAIN = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")


def test_the_page_can_be_dark(opened):
    page = opened("satellite")
    ground = "getComputedStyle(document.querySelector('main')).backgroundColor"
    light = page.tab.evaluate(ground)
    page.tab.click("[data-theme-button]")
    assert page.tab.evaluate(ground) != light
    assert page.tab.evaluate(browser_pages.LOOK) == []
    page.tab.emulate_media(media="print")
    assert page.tab.evaluate(ground) == light


def test_print_and_a_browser_without_scripts_show_still_pictures(opened):
    page = opened("satellite")
    shown = "document.querySelector('.panels').getClientRects().length > 0"
    assert not page.tab.evaluate(shown)
    page.tab.emulate_media(media="print")
    assert page.tab.evaluate(shown)
    assert not page.tab.is_visible("#explore")
    silent = opened("satellite", java_script_enabled=False)
    assert silent.tab.is_visible(".panels img")
    assert silent.tab.is_visible(".still")
    assert not silent.tab.is_visible("#explore")


LARGE = {
    "asteroid": lambda to: results_folders.asteroid(to, n_facets=100, n_curves=98),
    "satellite": lambda to: results_folders.faceted(to, step=0.2),
    "tumbler": lambda to: changed(results_folders.faceted(to, step=0.2), "tumbler", tumbling),
}


def test_a_tumble_of_24_s_is_wide_enough_to_judge(opened):
    """Its width in the light curve of one pass, and in the still figure of a pass of 300 s."""
    page = opened("satellite")
    page.set("segment", 1)
    low, high = page.view(CHART)
    assert page.box(CHART)["width"] * 24.0 / (high - low) > 50.0  # pixels
    page.tab.emulate_media(media="print")
    figure = page.tab.query_selector(".panels img").bounding_box()
    assert figure["width"] * 24.0 / 300.0 > 50.0


def test_a_dark_page_is_printed_on_white(opened):
    page = opened("satellite")
    page.tab.click("[data-theme-button]")
    dark = page.picture(CHART)
    page.tab.evaluate("dispatchEvent(new Event('beforeprint'))")
    assert page.tab.get_attribute("html", "data-theme") == "light"
    assert page.picture(CHART) != dark
    page.tab.evaluate("dispatchEvent(new Event('afterprint'))")
    assert page.tab.get_attribute("html", "data-theme") == "dark"
    assert page.picture(CHART) == dark


@pytest.mark.slow
@pytest.mark.parametrize("kind", LARGE)
def test_three_thousand_points_are_three_megabytes_and_open_in_a_second(browser, tmp_path, kind):
    folder = LARGE[kind](tmp_path / "large")
    assert contents.read(folder).t.size >= 2900
    lcbayes.report(folder)
    page = folder / "report.html"
    assert page.stat().st_size <= 3e6
    context = browser.new_context(viewport=browser_pages.WIDE)
    took = []
    for _ in range(3):
        tab = context.new_page()
        session = context.new_cdp_session(tab)
        session.send("Performance.enable", {"timeDomain": "threadTicks"})
        tab.goto(page.as_uri(), wait_until="load")
        metrics = session.send("Performance.getMetrics")["metrics"]
        # the page's thread's own time, which other work on the machine does not lengthen
        took += [m["value"] for m in metrics if m["name"] == "TaskDuration"]
        tab.close()
    context.close()
    assert 0.0 < min(took) <= 1.0
