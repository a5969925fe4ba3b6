"""Run time of each of the commands without an inversion on a light curve of 1,000 points.

python benchmarks/small_commands.py

Complete processes with their defaults, including start-up, compilation, figures and page. The data
are passes over four weeks of a satellite fixed in LVLH axes for `attitude-test` and `shape-match`,
one pass over two sites for `single-facet`, flashes of a wire for `glints`, and six passes of a
cylinder for `spin`.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from _results import table, write_section

sys.path.insert(0, str(Path(__file__).parents[1]))

import lcbayes
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.separated import ensemble
from lcbayes.physics.attitude import catalogue
from tests.helpers.low_earth_orbit import spinner
from tests.helpers.simulated_glints import wire_flashes
from tests.helpers.simulated_passes import measured, passes
from tests.helpers.single_facet_passes import crossing, flux_of, one_pass, with_noise

POINTS = 1000
LVLH = catalogue.find("lvlh")


def thinned(curve: LightCurve) -> LightCurve:
    assert curve.n_obs >= POINTS
    return curve.select(np.linspace(0, curve.n_obs - 1, POINTS).astype(int))


def curves() -> dict[str, LightCurve]:
    weeks = measured(
        thinned(passes(550.0, 53.0, days=28, step=10.0)),
        LVLH,
        ensemble.draw(8, np.random.default_rng(0)),
        0.03,
        0,
    )
    one = thinned(one_pass(3, step=0.25))
    edge = with_noise(one, flux_of(one, LVLH, crossing(one, LVLH, 5), 1.0), 0.01, 1)
    return {
        "spin": thinned(spinner(2013, 6, 50.0, "cylinder")[0]),
        "glints": thinned(wire_flashes(3, 50.0)[0]),
        "single-facet": edge,
        "attitude-test": weeks,
        "shape-match": weeks,
    }


def main() -> None:
    rows = []
    with tempfile.TemporaryDirectory() as scratch:
        for name, curve in curves().items():
            path = Path(scratch) / f"{name}.csv"
            lcbayes.write(curve, path)
            took = []
            for _ in range(2):
                command = [
                    sys.executable,
                    "-m",
                    "lcbayes",
                    name,
                    str(path),
                    "-o",
                    f"{scratch}/{name}",
                    "--json",
                ]
                begun = time.monotonic()
                done = subprocess.run(command, capture_output=True, text=True, check=False)
                took.append(time.monotonic() - begun)
                assert done.returncode in (0, 3), done.stderr
            rows.append([name, str(curve.n_obs), *(f"{t:.1f}" for t in took), str(done.returncode)])
            print(rows[-1], flush=True)
    heads = ["command", "points", "first run (s)", "second run (s)", "exit status"]
    text = "Goal: 30 s each.\n\n" + table(heads, rows)
    write_section("Commands without an inversion", "python benchmarks/small_commands.py", text)


if __name__ == "__main__":
    main()
