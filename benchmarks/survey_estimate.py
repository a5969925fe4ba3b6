"""Five million objects on paper, from the figures measured by `surveys.py` and `catalogues.py`.

    python benchmarks/survey_estimate.py

Reads the sections on surveys and on the GPU in RESULTS.md and writes the estimate beside them. The
time that a process takes to hand out an object has no script; it is given here.
"""

from __future__ import annotations

import re

from _results import RESULTS, table, write_section

OBJECTS = 5_000_000
MIB = 2**20
CORES = (2, 1000)
HANDED_OUT_MS = 6.1  # by Dask: 1,500 tasks of 17 kB to one worker, beside other work
READ_MS = 0.4  # an object, beside other work


def figures(text: str) -> dict[str, float]:
    """What was measured: seconds and kB an object, MiB of many objects."""
    sections = dict(re.findall(r"(?ms)^## Surveys: ([^\n]+)\n(.*?)(?=^## |\Z)", text))
    whole = sections["real objects as one table"]
    number = _only(r"\| objects \| (\d+) \|", whole)
    rows = re.findall(r"(?m)^\| (\d+) \| \d+ \| (\d+) \|", sections["memory of many objects"])
    (few, little), (many, much) = ((int(n), int(mib)) for n, mib in rows)
    return {
        "cpu_s": _only(r"Processor time of an object: ([\d.]+) s", sections["calibration"]),
        "journal_kb": _only(r"\| journal \(kB\) \| (\d+) \|", whole) / number,
        "table_kb": _only(r"\| table, Parquet and CSV \(kB\) \| (\d+),", whole) / number,
        "gpu_per_hour": _only(
            r"\| objects an hour, several threads \| ([\d,]+) ", sections["one GPU beside a CPU"]
        ),
        "more_objects": many - few,
        "more_mib": much - little,
    }


def _only(pattern: str, text: str) -> float:
    (value,) = re.findall(pattern, text)
    return float(value.replace(",", ""))


def _rounded(value: float) -> str:
    """To two figures."""
    return f"{float(f'{value:.2g}'):,.0f}"


def wall(hours: float) -> str:
    return f"{hours / 24:.0f} days" if hours > 72 else f"{hours:.0f} h"


def estimate(of: dict[str, float], objects: int = OBJECTS) -> list[list[str]]:
    """Rows of quantity, origin and estimate."""
    hours, handed_ms = objects * of["cpu_s"] / 3600, HANDED_OUT_MS + READ_MS
    most = 1000 * of["cpu_s"] / handed_ms
    real = '"Surveys: real objects as one table"'
    memory = of["more_mib"] / of["more_objects"] * objects * MIB / 1e9
    return [
        [
            "processor time",
            f'{of["cpu_s"]:g} s an object ("Surveys: calibration")',
            f"{_rounded(hours)} core hours",
        ],
        [
            "wall time",
            f"on {', '.join(f'{n:,}' for n in CORES)} cores",
            ", ".join(wall(hours / n) for n in CORES),
        ],
        [
            "wall time on one GPU",
            f'{of["gpu_per_hour"]:,.0f} objects an hour ("Surveys: one GPU beside a CPU")',
            wall(objects / of["gpu_per_hour"]),
        ],
        [
            "process that hands out objects",
            f"{HANDED_OUT_MS:g} ms an object for Dask beside other work (1,500 tasks of 17 kB to "
            f"one worker), {READ_MS:g} ms to read",
            f"{objects * handed_ms / 3.6e6:.0f} h of processor time: enough for about "
            f"{_rounded(most)} cores",
        ],
        ["journal", real, f"{of['journal_kb'] * objects / 1e6:.1f} GB"],
        ["table, Parquet", real, f"{of['table_kb'] * objects / 1e6:.1f} GB"],
        [
            "memory of that process",
            f"{of['more_mib']:.0f} MiB for {of['more_objects']:,.0f} objects more "
            '("Surveys: memory of many objects")',
            f"{memory:.1f} GB",
        ],
    ]


if __name__ == "__main__":
    rows = estimate(figures(RESULTS.read_text(encoding="utf-8")))
    text = (
        "Not measured. Objects of 100 points over four years, 2 to 1000 h, without refinement; "
        "cores as fast as those of the sections, not shared, with compiled programs.\n\n"
    )
    text += table(["quantity", "from", "five million objects"], rows)
    print(text)
    write_section(
        "Surveys: five million objects, an estimate",
        "python benchmarks/survey_estimate.py",
        text,
    )
