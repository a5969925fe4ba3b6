"""The figure of the paper, from the tables in benchmarks/RESULTS.md.

    python paper/make_figures.py          writes paper/figures/reliability.png

The file carries the digest of the tables it was made from, so that a test sees when they change.
"""

# pyright: reportUnknownMemberType=false, reportUnknownArgumentType=false
# pyright: reportUnknownVariableType=false
# (Matplotlib and SciPy come without complete types)

from __future__ import annotations

import hashlib
import re
import sys
from pathlib import Path
from typing import NamedTuple

import matplotlib as mpl
from matplotlib.figure import Figure
from scipy.stats import beta

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "benchmarks" / "RESULTS.md"
FIGURE = ROOT / "paper" / "figures" / "reliability.png"
SECTION = "Surveys: calibration"
TABLES = {"P of the period": "period", "P of pole and period": "pole and period"}
INTERVAL = 0.9
DIGEST = "Description"  # key in the metadata of the PNG


class Bin(NamedTuple):
    """Objects of similar probability: how many, their mean probability, and how many are right."""

    count: int
    mean: float
    right: int

    @property
    def interval(self) -> tuple[float, float]:
        """Central interval of the share that is right (Clopper & Pearson 1934)."""
        tail, k, n = (1.0 - INTERVAL) / 2.0, self.right, self.count
        low = 0.0 if k == 0 else float(beta.ppf(tail, k, n - k + 1))
        high = 1.0 if k == n else float(beta.ppf(1.0 - tail, k + 1, n - k))
        return low, high


def bins(results: str, heading: str) -> list[Bin]:
    """The rows of a table of probabilities in RESULTS.md."""
    section = results.split(f"\n## {SECTION}\n")[1].split("\n## ")[0]
    table = section.split(f"| {heading} |")[1].split("\n\n")[0]
    rows = re.findall(r"(?m)^\| [\d.]+ to [\d.]+ \| (\d+) \| ([\d.]+) \| (\d+) of (\d+) \|", table)
    return [Bin(int(n), float(mean), int(right)) for n, mean, right, _ in rows]


def digest(results: str) -> str:
    """Of the numbers that the figure shows."""
    shown = repr([bins(results, heading) for heading in TABLES])
    return hashlib.sha256(shown.encode()).hexdigest()


def draw(results: str) -> Figure:
    """Share of right answers against the probability that the package gave them."""
    figure = Figure(figsize=(6.4, 3.0), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    for axes, (heading, name) in zip(panels, TABLES.items(), strict=True):
        axes.plot([0, 1], [0, 1], color="0.6", linewidth=1)
        rows = bins(results, heading)
        share = [row.right / row.count for row in rows]
        ends = [row.interval for row in rows]
        away = [
            [s - low for s, (low, _) in zip(share, ends, strict=True)],
            [high - s for s, (_, high) in zip(share, ends, strict=True)],
        ]
        axes.errorbar([row.mean for row in rows], share, away, fmt="o", markersize=4, capsize=2)
        axes.set(xlabel=f"probability of the {name}", xlim=(-0.03, 1.03), ylim=(-0.03, 1.03))
    panels[0].set_ylabel("share that is right")
    return figure


def main(path: Path = FIGURE) -> None:
    results = RESULTS.read_text(encoding="utf-8")
    path.parent.mkdir(exist_ok=True)
    with mpl.rc_context({"font.size": 9, "axes.spines.top": False, "axes.spines.right": False}):
        draw(results).savefig(path, dpi=200, metadata={DIGEST: digest(results)})
    print(path, file=sys.stderr)


if __name__ == "__main__":
    main()
