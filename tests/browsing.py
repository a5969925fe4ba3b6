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

# What is wrong with the page as it stands; each entry is a line for the tester.
LOOK = """() => {
  const seen = (e) => e.getClientRects().length && getComputedStyle(e).visibility !== "hidden"
    && !e.closest("[hidden], .visually-hidden") && getComputedStyle(e).clip !== "rect(0px, 0px, 0px, 0px)";
  const pen = Object.assign(document.createElement("canvas"), { width: 1, height: 1 })
    .getContext("2d", { willReadFrequently: true });
  const known = {};
  const rgba = (colour) => known[colour] ||= (() => {
    pen.clearRect(0, 0, 1, 1); pen.fillStyle = colour; pen.fillRect(0, 0, 1, 1);
    const d = pen.getImageData(0, 0, 1, 1).data;
    return [d[0], d[1], d[2], d[3] / 255];
  })();
  const over = (top, under) => [0, 1, 2].map((i) => top[i] * top[3] + under[i] * (1 - top[3])).concat(1);
  const ground = (e) => {
    const layers = [];
    for (; e; e = e.parentElement) {
      const c = rgba(getComputedStyle(e).backgroundColor);
      if (c[3]) layers.push(c);
      if (c[3] === 1) break;
    }
    return layers.reverse().reduce((under, top) => over(top, under), [255, 255, 255, 1]);
  };
  // relative luminance and contrast, WCAG 2.2
  const light = (c) => [0.2126, 0.7152, 0.0722].reduce((sum, w, i) => {
    const x = c[i] / 255;
    return sum + w * (x <= 0.04045 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4);
  }, 0);
  const contrast = (a, b) => {
    const [x, y] = [light(a), light(b)].sort((p, q) => q - p);
    return (x + 0.05) / (y + 0.05);
  };
  const wrong = new Set();
  const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  let counted = 0;
  for (let node; (node = texts.nextNode());) {
    const e = node.parentElement;
    if (!node.data.trim() || ["SCRIPT", "STYLE", "NOSCRIPT"].includes(e.tagName) || !seen(e)) continue;
    counted += 1;
    const style = getComputedStyle(e), size = parseFloat(style.fontSize);
    const large = size >= 24 || (size >= 18.66 && parseInt(style.fontWeight) >= 700);
    const under = ground(e), ratio = contrast(over(rgba(style.color), under), under);
    if (ratio < (large ? 3 : 4.5))
      wrong.add(`contrast ${ratio.toFixed(2)}: <${e.tagName.toLowerCase()} class="${e.className}"> `
        + `${style.color} "${node.data.trim().slice(0, 30)}"`);
  }
  for (const image of document.images) {
    if (!image.hasAttribute("alt")) wrong.add(`an image without alt: ${image.src.slice(0, 80)}`);
    if (image.getAttribute("alt") === "" && !image.closest("a, td, [aria-hidden]"))
      wrong.add(`an image that says nothing: ${image.src.slice(0, 80)}`);
    if (seen(image) && image.complete && !image.naturalWidth) wrong.add(`a broken image: ${image.src.slice(0, 80)}`);
  }
  for (const canvas of document.querySelectorAll("canvas"))
    if (!(canvas.getAttribute("aria-label") || "").trim()) wrong.add("a canvas without a name");
  const out = document.documentElement.scrollWidth - document.documentElement.clientWidth;
  if (out > 0) {
    const widest = [...document.body.querySelectorAll("*")].filter(
      (e) => seen(e) && e.getBoundingClientRect().right > document.documentElement.clientWidth + 1
        && !e.closest(".scroll, pre, .table-wrapper"));
    wrong.add(`${out} px stick out at ${innerWidth}: `
      + widest.slice(0, 3).map((e) => `<${e.tagName} class="${e.className}">`).join(" "));
  }
  if (!document.title.trim()) wrong.add("no title");
  if (!document.documentElement.lang) wrong.add("no language");
  if (document.querySelectorAll("h1").length !== 1) wrong.add("not one h1");
  if (!counted) wrong.add("no text");
  if (window.bad) wrong.add("text of a file was run");
  return [...wrong];
}"""


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
        found = driver.chromium.launch(
            executable_path=executable(), args=["--no-sandbox", "--disable-gpu"]
        )
        try:
            yield found
        finally:
            found.close()


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
