"""The report that one can question, in a real browser: what each control does."""

from __future__ import annotations

import csv
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import lcbayes
from lcbayes.analysis import contents
from lcbayes.core.constants import HOUR_S
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.geometry.spherical import unit_vector
from lcbayes.modelling.priors import inertia_tensor
from lcbayes.physics.attitude import rotations
from lcbayes.physics.attitude.torque_free import torque_free_to_body
from tests.helpers import browser_pages, results_folders

CHART, BODY = "[data-is=chart] canvas", "[data-is=body] canvas"


@pytest.fixture(scope="module")
def folders(tmp_path_factory) -> dict[str, Path]:
    base = tmp_path_factory.mktemp("explore")
    made = {
        "satellite": results_folders.faceted(base / "satellite"),
        "asteroid": results_folders.asteroid(base / "asteroid", n_facets=60, n_curves=4),
    }
    for folder in made.values():
        lcbayes.report(folder)
    return made


class Opened:
    """A report in a tab, and what it complained of."""

    def __init__(self, tab: Any, page: Path) -> None:
        self.tab, self.faults = tab, []
        tab.on("console", lambda m: self.faults.append(m.text))
        tab.on("pageerror", lambda e: self.faults.append(str(e)))
        tab.on("request", lambda r: self._asked(r.url, page.as_uri()))
        tab.goto(page.as_uri(), wait_until="load")

    def _asked(self, url: str, page: str) -> None:
        if not url.startswith(("data:", "blob:", page)):
            self.faults.append(url)

    def set(self, name: str, value: object) -> None:
        self.tab.evaluate(
            "([name, value]) => { const e = document.querySelector(`[data-is=${name}]`); "
            "e.value = value; for (const t of ['input', 'change']) e.dispatchEvent(new Event(t)) }",
            [name, str(value)],
        )

    def press(self, name: str) -> None:
        self.tab.click(f"[data-is={name}]")

    def text(self, name: str) -> str:
        return self.tab.inner_text(f"[data-is={name}]")

    def view(self, where: str) -> list[float]:
        shown = self.tab.get_attribute(where, "data-view")
        return [float(x) for x in shown.split()]

    def box(self, where: str) -> dict[str, float]:
        element = self.tab.query_selector(where)
        element.scroll_into_view_if_needed()
        return element.bounding_box()

    def picture(self, where: str) -> str:
        return self.tab.eval_on_selector(where, "c => c.toDataURL()")


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
    told = page.tab.inner_text(".tip")
    assert "residual" in told
    assert "UTC" in told
    assert "phase angle" in told
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


def test_a_body_that_tumbles_is_turned_as_the_model_turns_it(opened, folders):
    """The satellite's draws, with an inertia tensor of each."""
    source = folders["satellite"]
    folder = shutil.copytree(source, source.with_name("tumbling"))
    rng = np.random.default_rng(2)
    with xr.open_datatree(folder / "posterior.nc", engine="h5netcdf") as stored:
        tree = stored.load()
    for k in range(2):
        node = tree[f"modes/{k}/posterior"].to_dataset()
        shape = (node.sizes["chain"], node.sizes["draw"], 5)
        node["inertia_base"] = (("chain", "draw", "shape"), 0.5 * rng.standard_normal(shape))
        tree[f"modes/{k}/posterior"] = xr.DataTree(node)
    (folder / "posterior.nc").unlink()
    tree.to_netcdf(folder / "posterior.nc", engine="h5netcdf")
    lcbayes.report(folder)
    folders["tumbling"] = folder
    page = opened("tumbling")
    results = contents.read(folder)
    draws = results.modes[0].draws.isel(chain=0, draw=0)
    tensor, moments = jax.jit(inertia_tensor)(jnp.asarray(draws["inertia_base"].to_numpy()), 1.0)
    assert moments[0] < 0.9 * moments[2]
    vectors = (jnp.asarray(results.constant[k].to_numpy()) for k in ("sun", "obs"))
    omega = jnp.asarray(draws["omega"].to_numpy())
    _, seen = jax.jit(torque_free_to_body)(jnp.asarray(results.t), omega, tensor, *vectors)
    for index in (0, 10, results.t.size - 1):
        page.set("time", index)
        assert page.view(BODY)[:3] == pytest.approx(np.asarray(seen[index]), abs=2e-3)


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


@pytest.mark.slow
def test_three_thousand_points_are_three_megabytes_and_open_in_a_second(browser, tmp_path):
    folder = results_folders.asteroid(tmp_path / "large", n_facets=100, n_curves=98)
    assert contents.read(folder).t.size >= 2900
    lcbayes.report(folder)
    page = folder / "report.html"
    assert page.stat().st_size <= 3e6
    context = browser.new_context(viewport=browser_pages.WIDE)
    took = []
    for _ in range(3):
        tab = context.new_page()
        tab.goto(page.as_uri(), wait_until="load")
        took.append(
            tab.evaluate("performance.getEntriesByType('navigation')[0].loadEventEnd") / 1000
        )
        tab.close()
    context.close()
    assert min(took) <= 1.0
