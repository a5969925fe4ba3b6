"""The page in a real browser: no errors, no requests, shapes that turn; skipped without one."""

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest
import results_folders

from lcbayes.analysis import report

BROWSER = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
pytestmark = pytest.mark.skipif(BROWSER is None, reason="no chromium or chrome on this machine")

WATCH = """<script>
window.faults = [];
addEventListener("error", (e) => faults.push(String(e.message)));
addEventListener("securitypolicyviolation", (e) => faults.push("blocked " + e.blockedURI));
</script>"""
ACT = """<script>
addEventListener("load", () => setTimeout(() => {
  const canvas = document.querySelector("canvas");
  const sum = () => {
    const d = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
    return d.reduce((s, x, i) => (s * 31 + x * (i % 7 + 1)) % 1000000007, 7);
  };
  const drag = (type, x, y) => canvas.dispatchEvent(
    new PointerEvent(type, { clientX: x, clientY: y, pointerId: 1, bubbles: true }));
  const seen = { start: [canvas.dataset.view, sum()] };
  drag("pointerdown", 100, 100); drag("pointermove", 190, 130); drag("pointerup", 190, 130);
  {
    seen.dragged = [canvas.dataset.view, sum()];
    drag("pointermove", 300, 300);  // no button is down
    canvas.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowLeft" }));
    {
      seen.key = [canvas.dataset.view, sum()];
      seen.wide = document.documentElement.scrollWidth - document.documentElement.clientWidth;
      seen.stills = [...document.querySelectorAll("img.still")].map((i) => i.offsetHeight);
      seen.broken = [...document.images].filter((i) => i.offsetHeight && !i.naturalWidth).length;
      seen.canvases = document.querySelectorAll("canvas").length;
      seen.faults = window.faults;
      const out = document.createElement("pre");
      out.id = "seen"; out.textContent = JSON.stringify(seen);
      document.body.append(out);
    }
  }
}, 200));
</script>"""


def browse(page: Path, folder: Path, width: int) -> dict:
    html = page.read_text(encoding="utf-8")
    probe = folder / f"probe-{width}.html"
    probe.write_text(
        html.replace("<title>", WATCH + "<title>", 1).replace("</body>", ACT + "</body>"),
        encoding="utf-8",
    )
    command = [
        str(BROWSER), "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage",
        f"--user-data-dir={folder / 'profile'}", f"--window-size={width},900",
        "--virtual-time-budget=8000", "--dump-dom", probe.as_uri(),
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    found = re.search(r'<pre id="seen">(.*?)</pre>', done.stdout, re.DOTALL)
    assert found, done.stderr[-2000:]
    return json.loads(found[1])


@pytest.mark.parametrize("kind", ["faceted", "asteroid"])
def test_shape_turns_and_the_page_fits(kind, tmp_path):
    make = {
        "faceted": results_folders.faceted,
        "asteroid": lambda d: results_folders.asteroid(d, n_facets=60, n_curves=4),
    }[kind]
    page = report.write(make(tmp_path / "results"))
    for width in (1280, 500):
        seen = browse(page, tmp_path, width)
        assert seen["faults"] == []
        assert seen["canvases"] == 2
        views, sums = zip(*(seen[k] for k in ("start", "dragged", "key")), strict=True)
        assert len(set(views)) == 3
        assert len(set(sums)) == 3
        assert seen["wide"] <= 0  # nothing sticks out to the side
        assert seen["stills"] == [0, 0]  # the pictures are for paper
        assert seen["broken"] == 0
