"""Vector images of a page draw what the files draw."""

from __future__ import annotations

import re
from urllib.parse import unquote
from xml.etree import ElementTree

import numpy as np
import pytest

from lcbayes.analysis import style

SVG, LINK = "{http://www.w3.org/2000/svg}", "{http://www.w3.org/1999/xlink}href"


def drawn(svg: str) -> list[tuple[str, tuple, list[float]]]:
    """Each path and marker in order: shape, style with what is inherited, and numbers of places."""
    root = ElementTree.fromstring(svg)
    shapes = {e.get("id"): e for e in root.iter() if e.get("id")}
    found = []

    def visit(element, inherited, places):
        own = {}
        for rule in filter(None, (element.get("style") or "").split(";")):
            name, value = rule.split(":", 1)
            own[name.strip()] = value.strip()
        rules = inherited | own
        places = places + [element.get(k) or "" for k in ("transform", "x", "y")]
        if element.tag == f"{SVG}use":
            name = (element.get(LINK) or element.get("href"))[1:]
            visit(shapes[name], rules, places)
        elif mark := element.get("marker-mid"):
            assert {element.get(f"marker-{k}") for k in ("start", "mid", "end")} == {mark}
            assert {element.get(k) for k in ("fill", "stroke")} == {"none"}
            marker = shapes[mark[5:-1]]
            assert marker.get("overflow") == "visible"
            assert marker.get("markerUnits") == "userSpaceOnUse"
            for x, y in re.findall("([0-9.]+) ([0-9.]+)", element.get("d")):
                mark_rules = dict(r.split(":") for r in (marker.get("style") or "").split(";"))
                visit(marker[0], inherited | mark_rules, [*places, x, y])
        elif element.tag == f"{SVG}path":
            path = element.get("d") or ""
            numbers = re.findall(r"-?\d+\.?\d*(?:e-?\d+)?", " ".join([*places, path]))
            found.append(
                (
                    re.sub(r"[^A-Za-z]", "", path),
                    tuple(sorted(rules.items())),
                    [*map(float, numbers)],
                )
            )
        elif element.tag not in {f"{SVG}{tag}" for tag in ("defs", "clipPath", "marker")}:
            for child in element:
                visit(child, rules, places)

    visit(root, {}, [])
    return found


@pytest.fixture(scope="module")
def images(tmp_path_factory):
    """The file and the address of a figure with lines, two kinds of markers, a cloud and text."""
    folder = tmp_path_factory.mktemp("figures")
    rng = np.random.default_rng(3)
    with style.drawing():
        gallery = style.Gallery(folder)
        figure = gallery.figure(4.0, 3.0)
        axes = figure.subplots()
        axes.plot(rng.normal(size=40), "o", ms=2, color="#d55e00")
        axes.plot(rng.normal(size=40), "s-", ms=3, mfc="none", color="#0072b2", alpha=0.5)
        axes.plot(rng.normal(size=400), ".", rasterized=True)
        axes.set_xlabel("time (s), Sun's <bright> side & more")
        image = gallery.add(figure, "mixed", "A figure.")
    return (folder / "mixed.svg").read_text("utf-8"), image.src


def test_the_image_of_a_page_draws_what_the_file_draws(images):
    file, src = images
    before, after = drawn(file), drawn(unquote(src.partition(",")[2]))
    assert len(before) == len(after) > 100
    for (shape, rules, numbers), (shape2, rules2, numbers2) in zip(before, after, strict=True):
        assert (shape, rules) == (shape2, rules2)
        np.testing.assert_allclose(numbers2, numbers, atol=0.0101)


def test_the_address_of_an_image_ends_at_no_quote(images):
    _, src = images
    assert set('"<>&#%') & set(re.sub("%[0-9A-F]{2}", "", src)) == set()


def test_a_marker_takes_less_than_twenty_characters(tmp_path):
    lengths = []
    for n in (1000, 2000):
        with style.drawing():
            gallery = style.Gallery(tmp_path)
            figure = gallery.figure(4.0, 3.0)
            figure.subplots().plot(np.sin(np.arange(n)), "o", ms=2, color="#d55e00")
            lengths.append(len(gallery.add(figure, "markers", "Markers.").src))
    assert np.diff(lengths)[0] < 20 * 1000  # those of its coordinates; a use of its own takes 105
