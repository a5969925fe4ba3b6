"""The search of sparse points beside the C program `period_scan`, near the same periods.

    python benchmarks/period_scan.py PROGRAM [OBJECT ...]     all real objects with sparse points

PROGRAM is the executable of Kaasalainen and Durech, from the sources that DAMIT offers. It fits a
convex body from six poles at each trial period. All periods from 2 to 1000 h would take it hours an
object, so it searches a window about the best period of lcbayes. Its settings are those of the
inputs of Asteroids@home, which this needs as `surveys.py` does.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import tempfile
import time
from itertools import pairwise
from pathlib import Path

import numpy as np
from _results import table, write_section
from _surveys import HEADER, folder, read_cadence
from surveys import curve, load

from lcbayes.core.constants import DAY_S, HOUR_S
from lcbayes.inversion.attitude_scan import sparse
from lcbayes.inversion.attitude_scan.harmonics import SparsePoints

TRIALS = 200  # periods of the window
PARTS = 20  # of the window, each scanned alone, because the program stops at a singular matrix
STEP = 0.5  # between them, in units of the least that one turn over the data allows
RANGE_H = (2.0, 1000.0)


def settings(path: Path, start_h: float, end_h: float) -> str:
    """Those of an input of Asteroids@home in the form of the program."""
    lines = path.read_text(encoding="utf-8").splitlines()[3:HEADER]
    return "\n".join([f"{start_h:.10f} {end_h:.10f} {STEP}", *lines]) + "\n"


def light_curves(path: Path) -> str:
    """Those of an input, whose counts are followed by no more than the kind of curve."""
    lines = path.read_text(encoding="utf-8").splitlines()[HEADER:]
    return "\n".join(" ".join(s.split()[:2]) if len(s.split()) < 8 else s for s in lines) + "\n"


def scanned(program: Path, path: Path, start_h: float, end_h: float) -> tuple[np.ndarray, float]:
    """Periods (h) and rms of the program, (n, 2), and its processor time, s."""
    return run(program, settings(path, start_h, end_h), light_curves(path))


def run(program: Path, of: str, light: str) -> tuple[np.ndarray, float]:
    """As `scanned`, of settings and light curves in the forms of the program.

    Periods after one at which the program stops are missing.
    """
    with tempfile.TemporaryDirectory() as scratch:
        given, out = Path(scratch) / "settings", Path(scratch) / "out"
        given.write_text(of, encoding="utf-8")
        before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
        command = [str(program), str(given), str(out)]
        subprocess.run(command, input=light, text=True, capture_output=True, check=False)
        took = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before
        rows = [line.split()[:2] for line in out.read_text(encoding="utf-8").splitlines()]
        return np.array(rows, float).reshape(-1, 2), took


def main() -> None:
    parser = argparse.ArgumentParser(description="Compare with the C program period_scan.")
    parser.add_argument("program", type=Path)
    parser.add_argument("objects", nargs="*", help="their numbers")
    options = parser.parse_args()
    names = options.objects or [f.name.rpartition("_")[2] for f in sorted(folder().iterdir())]
    rows = []
    for name in names:
        file = folder() / f"period_search_in_{name}"
        given = curve(read_cadence(file))
        if not sparse.is_sparse(given):
            continue
        points = SparsePoints.of(given)
        begun = time.process_time()
        found = sparse.search(points, RANGE_H)
        own = time.process_time() - begun
        best = found.spins[0].frequency * HOUR_S
        span = points.span / HOUR_S
        half = 0.5 * TRIALS * STEP * 0.5 / span
        start, end = 1.0 / (best + half), 1.0 / max(best - half, 1.0 / RANGE_H[1])
        edges = 1.0 / np.linspace(1.0 / start, 1.0 / end, PARTS + 1)
        parts = [scanned(options.program, file, *at) for at in pairwise(edges)]
        scan, took = np.concatenate([p for p, _ in parts]), sum(t for _, t in parts)
        period = float(scan[np.argmin(scan[:, 1]), 0])
        trials = len(scan)
        whole = (1.0 / RANGE_H[0] - 1.0 / RANGE_H[1]) * span / (0.5 * STEP)
        turns = abs(1.0 / period - best) * span
        rows.append(
            [
                name,
                f"{given.n_obs}",
                f"{span * HOUR_S / DAY_S:.0f}",
                f"{found.period_probability:.3f}",
                f"{1.0 / best:.5f}",
                f"{period:.5f}",
                f"{turns:.2f}",
                f"{trials}",
                f"{scan[:, 1].min():.4f}",
                f"{took / trials:.3f}",
                f"{whole * took / trials / HOUR_S:.1f}",
                f"{own:.0f}",
            ]
        )
        print(*rows[-1], flush=True)
    same = sum(float(r[6]) < sparse.SAME_PERIOD for r in rows)
    likely = [r for r in rows if float(r[3]) >= 0.9]
    text = (
        f"{len(rows)} sparse objects. The program tries {TRIALS} periods about the best of "
        "lcbayes; its best is the least rms among them, so that it can only disagree within this "
        "window. Where it stops at a singular matrix, some periods are missing. The best of both "
        f"agree to one turn over the data in {same} of {len(rows)}, and in "
        f"{sum(float(r[6]) < sparse.SAME_PERIOD for r in likely)} of {len(likely)} with P ≥ 0.9. "
        "The time of the program for 2 to 1000 h follows from that of a period, and is not "
        "measured. Processor times; the first of lcbayes includes compilation. Load at the end: "
        f"{load()}.\n\n"
    )
    heads = ["object", "points", "days", "P of period", "lcbayes (h)", "C program (h)"]
    heads += ["turns between", "its periods", "its rms", "C program, a period (CPU s)"]
    heads += ["for 2 to 1000 h (CPU h)", "lcbayes, all (CPU s)"]
    write_section(
        "Surveys: beside the C program",
        f"python benchmarks/period_scan.py PROGRAM {' '.join(options.objects)}",
        text + table(heads, rows),
    )


if __name__ == "__main__":
    main()
