"""Benchmarks of many simulated cases: a CSV file with one row a case, resumed where it stopped."""

from __future__ import annotations

import argparse
import csv
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from _results import table, write_section
from _scores import Rate, encoded, pooled, share

COLUMNS: tuple[str, ...] = (
    "cell",
    "size",
    "seed",
    "trusted",
    "inside",
    "of",
    "outside",
    "reasons",
    "solutions",
    "chi2",
    "dof",
    "seconds",
    "about",
)


class Outcome(NamedTuple):
    """What a fit printed, against the truth."""

    trusted: bool
    inside: Mapping[str, bool]
    reasons: Sequence[str]  # codes
    solutions: int
    chi2: float | None  # None if the file has no errors
    dof: float
    about: str  # of the case, such as "2 sites, 3 passes, 1 night"


class Cell(NamedTuple):
    """A kind of fault at one size."""

    name: str
    size: float

    def __str__(self) -> str:
        return self.name if self.size == 0 else f"{self.name}:{self.size:g}"


def arguments(doc: str | None, cells: Sequence[Cell], seeds: int) -> argparse.Namespace:
    """The command line: ``cells`` as chosen, ``seeds`` of each, and the folder of the rows."""
    parser = argparse.ArgumentParser(
        description=doc, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-o", "--out", type=Path, required=True, help="folder of cases.csv")
    parser.add_argument(
        "--cells", default="all", help=f"of {', '.join(map(str, cells))}; a name alone: all sizes"
    )
    parser.add_argument("--seeds", type=int, default=seeds, help="cases in each cell")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--table-only", action="store_true", help="print the table of past cases")
    parser.add_argument("--write", action="store_true", help="write the table into RESULTS.md")
    given = parser.parse_args()
    wanted = [str(c) for c in cells] if given.cells == "all" else given.cells.split(",")
    chosen = [c for c in cells if str(c) in wanted or c.name in wanted]
    if unknown := [w for w in wanted if not any(w in (str(c), c.name) for c in cells)]:
        parser.error(f"unknown cell {', '.join(unknown)}; available: {', '.join(map(str, cells))}")
    given.cells = chosen
    return given


def command(
    doc: str | None,
    cells: Sequence[Cell],
    seeds: int,
    case: Callable[[Cell, int, Path], Outcome],
    title: str,
) -> None:
    """A benchmark from its command line to its table in RESULTS.md."""
    given = arguments(doc, cells, seeds)
    rows = run(given, case, "quantities")
    if given.write:
        script = Path(sys.argv[0]).name
        text = report(rows, given.cells, "quantities")
        write_section(title, f"python benchmarks/{script} -o DIR --write", text)


def run(
    given: argparse.Namespace, case: Callable[[Cell, int, Path], Outcome], what: str
) -> list[dict[str, str]]:
    """Run the cases that are not in ``cases.csv`` yet; returns all rows of the chosen cells.

    The first seed of every cell comes first, so that a run that is stopped has some of each. A
    case that raises an error counts as not trusted, with the error as its reason.
    """
    given.out.mkdir(parents=True, exist_ok=True)
    path = given.out / "cases.csv"
    rows = load(path)
    done = {(r["cell"], float(r["size"]), int(r["seed"])) for r in rows}
    seeds = range(given.first_seed, given.first_seed + given.seeds)
    cells: list[Cell] = given.cells
    for seed, cell in [(s, c) for s in seeds for c in cells]:
        if given.table_only or (cell.name, cell.size, seed) in done:
            continue
        begun = time.monotonic()
        try:
            result = case(cell, seed, given.out)
        except Exception as fault:
            fault_name = f"{type(fault).__name__}: {fault}"
            result = Outcome(False, {}, [fault_name[:200]], 0, np.nan, np.nan, "")
        row = _row(cell, seed, result, time.monotonic() - begun)
        _append(path, row)
        rows.append(row)
        verdict = "trusted" if result.trusted else f"not trusted ({row['reasons']})"
        print(
            f"{cell}, seed {seed}: {verdict}, {row['inside']} of {row['of']} inside, "
            f"{row['seconds']} s; {result.about}",
            flush=True,
        )
    chosen = {(c.name, c.size) for c in given.cells}
    rows = [r for r in rows if (r["cell"], float(r["size"])) in chosen]
    print("\n" + report(rows, given.cells, what))
    return rows


def load(path: Path) -> list[dict[str, str]]:
    """Rows of ``cases.csv``; a last row that was cut off is left out."""
    if not path.exists():
        return []
    with path.open(newline="", encoding="utf-8") as file:
        return [row for row in csv.DictReader(file) if row["about"] is not None]


def _row(cell: Cell, seed: int, result: Outcome, seconds: float) -> dict[str, str]:
    values = (
        cell.name,
        f"{cell.size:g}",
        seed,
        int(result.trusted),
        sum(result.inside.values()),
        len(result.inside),
        encoded(result.inside),
        ";".join(result.reasons),
        result.solutions,
        "" if result.chi2 is None else f"{result.chi2:.1f}",
        f"{result.dof:.1f}",
        f"{seconds:.1f}",
        result.about,
    )
    return {k: str(v) for k, v in zip(COLUMNS, values, strict=True)}


def _append(path: Path, row: Mapping[str, str]) -> None:
    new = not path.exists()
    with path.open("a", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        if new:
            writer.writerow(COLUMNS)
        writer.writerow([row[name] for name in COLUMNS])


def report(rows: Sequence[Mapping[str, str]], cells: Sequence[Cell], what: str) -> str:
    """Shares of trusted fits and of quantities inside, by cell and over all, with their errors."""
    lines = [_line(str(c), [r for r in rows if _of(r, c)]) for c in cells]
    lines = [line for line in lines if line[1] != "0"]
    faulty = [r for r in rows if float(r["size"]) != 0]
    if faulty and len(lines) > 1:
        lines.append(_line("all with a fault", faulty))
    heads = ["cell", "cases", "trusted", f"{what} inside 90 %, trusted", "not trusted", "s a case"]
    total = sum(float(r["seconds"]) for r in rows)
    took = f"{len(rows)} cases took {total / 3600:.2f} hours." if rows else ""
    return f"{table(heads, lines)}\n\nErrors are standard errors of the simulation. {took}"


def _of(row: Mapping[str, str], cell: Cell) -> bool:
    return row["cell"] == cell.name and float(row["size"]) == cell.size


def _line(name: str, rows: Sequence[Mapping[str, str]]) -> list[str]:
    def inside(chosen: Sequence[Mapping[str, str]]) -> Rate:
        return pooled(
            np.array([int(r["inside"]) for r in chosen]), np.array([int(r["of"]) for r in chosen])
        )

    trusted = [r for r in rows if r["trusted"] == "1"]
    others = [r for r in rows if r["trusted"] != "1"]
    counts = f"({sum(int(r['inside']) for r in trusted)} of {sum(int(r['of']) for r in trusted)})"
    seconds = f"{np.median([float(r['seconds']) for r in rows]):.0f}" if rows else "–"
    return [
        name,
        str(len(rows)),
        str(share(len(trusted), len(rows))),
        f"{inside(trusted)} {counts}" if trusted else "–",
        str(inside(others)),
        seconds,
    ]
