"""Start-up time of the command line and of the import.

python benchmarks/start_up.py

Complete processes, best and median of 21, after one that is not counted: `lcbayes --help`, and
`import lcbayes` compared with the start of the interpreter alone.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import time

from _results import table, write_section

RUNS = 21
WHAT = {
    "`python -c pass`": (["-c", "pass"], None),
    "`import lcbayes`": (["-c", "import lcbayes"], 0.5),
    "`lcbayes --help`": (["-m", "lcbayes", "--help"], 0.4),
    "`lcbayes fit --help`": (["-m", "lcbayes", "fit", "--help"], 0.4),
}


def seconds(words: list[str]) -> list[float]:
    took = []
    for _ in range(RUNS + 1):
        begun = time.perf_counter()
        subprocess.run([sys.executable, *words], check=True, stdout=subprocess.DEVNULL)
        took.append(time.perf_counter() - begun)
    return took[1:]


def main() -> None:
    load, rows = os.getloadavg()[0], []
    for name, (words, goal) in WHAT.items():
        took = seconds(words)
        cells = [f"{min(took):.3f}", f"{statistics.median(took):.3f}"]
        rows.append([name, *cells, "" if goal is None else f"{goal:g}"])
        print(*rows[-1], flush=True)
    text = table(["whole process", "best (s)", "median (s)", "goal (s)"], rows)
    text += f"\n\nOther work on the machine: load average {load:.1f} at the beginning."
    write_section("Start-up", "python benchmarks/start_up.py", text)


if __name__ == "__main__":
    main()
