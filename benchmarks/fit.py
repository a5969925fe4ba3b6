"""Complete fits from the command line: the demo problem, and asteroids with a known spin.

python benchmarks/fit.py demo            the demo problem, twice; the second run counts
python benchmarks/fit.py asteroids       Ariadne and Hertha from $LCBAYES_DATA or ../shared/data
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from _results import table, write_section

ROOT = Path(__file__).parents[1]
SCENARIOS = ROOT / "lcbayes" / "simulation" / "scenarios"
DATA = Path(os.environ.get("LCBAYES_DATA", ROOT.parent / "shared" / "data"))
DEMO = ["box-wing.csv", "--tle", "box-wing.tle", "--n-facets", "6", "--seed", "1"]
# name: file, given period (h), published pole (deg, ecliptic J2000) and period (h)
ASTEROIDS = {
    "Ariadne": ("43_Ariadne_rel.lcs", "5.762", "(253.2, −17.2), mirror (70.3, −16.1)", "5.761980"),
    "Hertha": ("135_Hertha.lcs", "8.4006", "(272, +52.2), mirror (88-96, +53-58)", "8.400599"),
}


def fit(arguments: list[str], where: Path) -> tuple[dict[str, Any], float, int]:
    """Summary, wall-clock seconds and exit code of `lcbayes fit` in a separate folder."""
    environment = dict(os.environ)
    environment["PYTHONPATH"] = os.pathsep.join([str(ROOT), environment.get("PYTHONPATH", "")])
    begun = time.monotonic()
    with tempfile.TemporaryDirectory() as out:
        command = [sys.executable, "-m", "lcbayes", "fit", *arguments, "-o", out]
        run = subprocess.run(command, cwd=where, env=environment, capture_output=True, text=True)
        took = time.monotonic() - begun
        if run.returncode not in (0, 3):
            sys.exit(f"{' '.join(arguments)}: exit {run.returncode}\n{run.stderr[-2000:]}")
        return json.loads((Path(out) / "summary.json").read_text()), took, run.returncode


def demo() -> None:
    first, second = fit(DEMO, SCENARIOS), fit(DEMO, SCENARIOS)
    rows = [
        [name, f"{took:.1f}", str(code), f"{s['max_rhat']:.3f}", f"{s['min_ess_bulk']:.0f}"]
        for name, (s, took, code) in (("first", first), ("second", second))
    ]
    same = first[0]["parameters"] == second[0]["parameters"]
    text = table(["run", "wall time (s)", "exit code", "max R-hat", "min bulk ESS"], rows)
    text += f"\n\nGoal: the second under 45 s. Numbers of both runs identical: {same}.\n\n"
    parts = {k: v for k, v in second[0]["timing"].items() if k.endswith("_s")}
    text += "Of the second: " + ", ".join(f"{k[:-2]} {v:.1f} s" for k, v in parts.items()) + "."
    write_section("The demo from the command line", "python benchmarks/fit.py demo", text)


def asteroids() -> None:
    rows, known = [], []
    for name, (file, period, pole, published) in ASTEROIDS.items():
        path = DATA / "damit" / file
        if not path.is_file():
            sys.exit(f"{path} is not there; set LCBAYES_DATA to the folder that holds damit/")
        command = [str(path), "--model", "convex-grid", "--period", period, "--seed", "1"]
        summary, took, code = fit(command, ROOT)
        for i, mode in enumerate(summary["modes"]):
            rows.append(
                [
                    f"{name} {i + 1}",
                    f"{mode['weight']:.2f}",
                    f"({mode['pole_lon_deg']:.1f}, {mode['pole_lat_deg']:.1f})",
                    f"{mode['period_h']:.6f}",
                    f"{mode['rms']:.4f}",
                    f"{mode['max_rhat']:.3f}",
                    f"{mode['min_ess_bulk']:.0f}",
                    f"{took:.0f}" if i == 0 else "",
                    str(code) if i == 0 else "",
                ]
            )
        known.append(f"{name}: pole {pole}, period {published} h.")
    heads = [
        "solution",
        "weight",
        "pole (deg)",
        "period (h)",
        "rms",
        "max R-hat",
        "min bulk ESS",
        "wall time (s)",
        "exit code",
    ]
    text = table(heads, rows) + "\n\nPublished. " + " ".join(known)
    text += " Goals: best pole within 3°, period within 1e-5 h, R-hat at most 1.01, bulk ESS at"
    text += " least 400, Ariadne's rms at most 0.0152, each command under 300 s."
    title = "Asteroids with a known spin, no pole given"
    write_section(title, "python benchmarks/fit.py asteroids", text)


if __name__ == "__main__":
    parts = {"demo": demo, "asteroids": asteroids}
    chosen = sys.argv[1:] or list(parts)
    if unknown := set(chosen) - set(parts):
        sys.exit(f"unknown part {', '.join(sorted(unknown))}; available: {', '.join(parts)}")
    for part in chosen:
        parts[part]()
