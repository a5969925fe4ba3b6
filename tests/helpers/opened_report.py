"""A report in a tab of a browser, and results folders with other draws."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import lcbayes


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


def changed(source: Path, name: str, change: Any, **summary: Any) -> Path:
    """A copy of a results folder with other draws, and its report.

    ``change(dataset, rng)`` gives new draws of a solution; ``summary`` replaces what it says.
    """
    folder = shutil.copytree(source, source.with_name(name))
    rng = np.random.default_rng(2)
    with xr.open_datatree(folder / "posterior.nc", engine="h5netcdf") as stored:
        tree = stored.load()
    for k in range(2):
        node = change(tree[f"modes/{k}/posterior"].to_dataset(), rng)
        tree[f"modes/{k}/posterior"] = xr.DataTree(node)
    tree.attrs["model"] = summary.get("model", tree.attrs["model"])
    (folder / "posterior.nc").unlink()
    tree.to_netcdf(folder / "posterior.nc", engine="h5netcdf")
    content = json.loads((folder / "summary.json").read_text()) | summary
    (folder / "summary.json").write_text(json.dumps(content))
    lcbayes.report(folder)
    return folder
