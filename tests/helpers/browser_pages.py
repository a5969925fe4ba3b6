"""Pages in a real browser: what a reader would meet on a wide screen and on a telephone."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import Any

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
# Names and reasons that would run if they were not escaped: as an image, and out of a script.
EVIL_FILE = "<img src=x onerror='window.bad=1'>.csv"
EVIL_TEXT = "</script><script>window.bad=1</script><b>\"'&"
WIDE, NARROW = {"width": 1280, "height": 900}, {"width": 390, "height": 844}

LOOK = Path(__file__).with_suffix(".js").read_text(encoding="utf-8").partition("\n")[2]


@dataclass
class Seen:
    """What a page did while it was looked at."""

    faults: list[str] = field(default_factory=list)
    views: list[list[str]] = field(default_factory=list)  # of each canvas, before and after turns


def has_driver() -> bool:
    return find_spec("playwright") is not None


def executable() -> str | None:
    return next(filter(None, map(shutil.which, NAMES)), None)


@contextmanager
def chromium() -> Iterator[Any]:
    """A headless Chromium, driven through its DevTools."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        started = driver.chromium.launch(
            executable_path=executable(), args=["--no-sandbox", "--disable-gpu"]
        )
        try:
            yield started
        finally:
            started.close()


def look(
    browser: Any,
    page: Path,
    within: Path | None = None,
    widths: Sequence[Any] = (WIDE, NARROW),
    turn: bool = True,
) -> Seen:
    """Open a page at each width; turn what can be turned.

    ``within``: the folder whose files it may load; by default it must need no other.
    """
    result = Seen()
    allowed = page.as_uri() if within is None else within.as_uri() + "/"
    context = browser.new_context(viewport=widths[0])
    try:
        tab = context.new_page()
        tab.on("console", lambda m: _note(result, m.type in ("error", "warning"), m.text))
        tab.on("pageerror", lambda e: _note(result, True, str(e)))
        tab.on("dialog", lambda d: (_note(result, True, "a dialog"), d.dismiss()))
        tab.on("request", lambda r: _note(result, not _inside(r.url, allowed), f"asks for {r.url}"))
        tab.on("requestfailed", lambda r: _note(result, True, f"did not get {r.url}"))
        for i, size in enumerate(widths):
            tab.set_viewport_size(size)
            if i == 0:
                tab.goto(page.as_uri(), wait_until="load")
            result.faults += tab.evaluate(LOOK)
        tab.set_viewport_size(widths[0])
        tab.emulate_media(color_scheme="dark")
        result.faults += [f"dark: {fault}" for fault in tab.evaluate(LOOK)]
        tab.emulate_media(color_scheme="light")
        if turn:
            result.views = [_turn(tab, canvas) for canvas in tab.query_selector_all("canvas")]
    finally:
        context.close()
    return result


def _inside(url: str, allowed: str) -> bool:
    return url.startswith(("data:", "blob:")) or url.split("#")[0].startswith(allowed)


def _note(result: Seen, wrong: bool, text: str) -> None:
    if wrong:
        result.faults.append(text)


def _turn(tab: Any, canvas: Any) -> list[str]:
    """Pictures of a canvas as it is, dragged by the mouse, turned by a key, and put back."""
    canvas.scroll_into_view_if_needed()
    drawn = "c => c.toDataURL()"
    pictures = [canvas.evaluate(drawn)]
    box = canvas.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    tab.mouse.move(x, y)
    tab.mouse.down()
    tab.mouse.move(x + 90, y + 30, steps=3)
    tab.mouse.up()
    pictures.append(canvas.evaluate(drawn))
    tab.mouse.move(x - 60, y)  # no button is down: nothing turns
    assert canvas.evaluate(drawn) == pictures[1]
    canvas.press("ArrowLeft")
    pictures.append(canvas.evaluate(drawn))
    canvas.dblclick()
    pictures.append(canvas.evaluate(drawn))
    return pictures
