"""Command lines that go on from a light curve or a result."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

from lcbayes.data.lightcurve import LightCurve
from lcbayes.results.result import Result

FACETS = "3"  # of a first fit
BODY = "rocket-stage"  # of the bundled bodies


def command(curve: LightCurve, task: str, *words: str, out: str = "") -> str:
    """A command line for the file of a light curve, with the options it was read with."""
    line = ["lcbayes", task, curve.source.get("file") or "CURVE", *words]
    for name, value in json.loads(curve.source.get("reading", "{}")).items():
        line += [f"--{name.replace('_', '-')}", str(value)]
    return shlex.join([*line, "-o", out or (task if task != "fit" else "out")])


def onward(result: Result) -> list[str]:
    """Lines with the commands that fit a body at the spins of a result.

    Empty unless the result is of a light curve and has been written to a folder.
    """
    folder, curve = result.folder, result.source
    if folder is None or not isinstance(curve, LightCurve):
        return []
    asteroid = curve.frame == "ecliptic-j2000"
    words = ("--model", "convex-grid") if asteroid else ("--n-facets", FACETS)
    out = str(Path(f"{folder}-fit"))
    first = command(curve, "fit", *words, "--start-from", str(folder), out=out)
    if asteroid:
        return [f"to go on from here: {first}"]
    body = ("--model", "body", "--body", BODY, "--start-from", str(folder))
    known = command(curve, "fit", *body, out=f"{folder}-body")
    return [
        f"to go on from here, if the body is unknown: {first}",
        f"or, if its kind is known, with a bundled body (lcbayes models body lists them) or a file "
        f"of a dozen lines (docs/bodies.md): {known}",
    ]
