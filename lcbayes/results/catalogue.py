"""The table of a batch as CSV, and its content as a summary."""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from lcbayes.core.files import printable
from lcbayes.modelling.variables import SPIN

TRUSTED, DOUBTED, FAILED = "trusted", "not trusted", "failed"
ROW = (
    "name",
    "status",
    "model",
    "n_facets",
    "n_obs",
    "n_solutions",
    "weight",
    "chi2",
    "dof",
    "rms",
    "max_rhat",
    "min_ess_bulk",
    "albedo_area_m2",
    "albedo_area_m2_sd",
)
LAST = ("seconds", "curve", "reasons")


def heads(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """The columns: those that every fit has, then those that any of these has."""
    spins = [k for name in SPIN for k in (name, f"{name}_sd") if any(k in r for r in rows)]
    return [*ROW, *spins, *LAST]


def to_csv(rows: Sequence[Mapping[str, Any]]) -> str:
    """One line an object; numbers as they are, an empty cell where there is none."""
    columns = heads(rows)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    for row in rows:
        cells = {
            **row,
            "curve": printable(row.get("curve", "")),
            "reasons": "; ".join(row["reasons"]),
        }
        writer.writerow(["" if cells.get(k) is None else cells[k] for k in columns])
    return text.getvalue()


def summarise(
    catalogue: str | Path,
    rows: Sequence[Mapping[str, Any]],
    n_objects: int,
    reused: int,
    seconds: float,
    who: str,
) -> dict[str, Any]:
    """The content of ``batch.json``."""
    count = Counter(row["status"] for row in rows)
    new = len(rows) - reused
    reasons = []
    if count[FAILED]:
        names = [row["name"] for row in rows if row["status"] == FAILED]
        reasons.append(f"{count[FAILED]} of {n_objects} objects failed: {_few(names)}")
    if count[DOUBTED]:
        names = [row["name"] for row in rows if row["status"] == DOUBTED]
        reasons.append(
            f"{count[DOUBTED]} of {n_objects} results must not be trusted: {_few(names)}"
        )
    if len(rows) < n_objects:
        reasons.append(f"{n_objects - len(rows)} of {n_objects} objects were not done")
    return {
        "catalogue": str(catalogue),
        "converged": not reasons,
        "reasons": reasons,
        "n_objects": n_objects,
        "n_trusted": count[TRUSTED],
        "n_not_trusted": count[DOUBTED],
        "n_failed": count[FAILED],
        "n_done_before": reused,
        "seconds": seconds,
        "objects_per_hour": 3600.0 * new / seconds if new else None,
        "workers": who,
        "objects": list(rows),
    }


def _few(names: Sequence[str], most: int = 8) -> str:
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more
