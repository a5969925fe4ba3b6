"""The table of a batch, and its summary."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from lcbayes.core.files import printable
from lcbayes.core.reasons import Finding
from lcbayes.modelling.variables import SPIN
from lcbayes.results.content import BatchNumbers

TRUSTED, NOT_TRUSTED, FAILED = "trusted", "not trusted", "failed"
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
    """The columns: those common to all fits, and those of the spin that occur in these rows."""
    spins = [k for name in SPIN for k in (name, f"{name}_sd") if any(k in r for r in rows)]
    return [*ROW, *spins, *LAST]


def cells(row: Mapping[str, Any]) -> dict[str, Any]:
    """An object as a row of the table; missing values are empty."""
    texts = {
        "curve": printable(row.get("curve", "")),
        "reasons": "; ".join(reason["text"] for reason in row["reasons"]),
    }
    return {name: "" if value is None else value for name, value in {**row, **texts}.items()}


def summarise(
    catalogue: str | Path,
    rows: Sequence[Mapping[str, Any]],
    n_objects: int,
    reused: int,
    seconds: float,
    who: str,
) -> tuple[BatchNumbers, list[Finding]]:
    """The content of ``summary.json`` besides the verdict, and the findings against the result."""
    count = Counter(row["status"] for row in rows)
    new = len(rows) - reused
    against: list[Finding] = []
    if count[FAILED]:
        names = [row["name"] for row in rows if row["status"] == FAILED]
        values = {"count": count[FAILED], "objects": n_objects, "names": _few(names)}
        against.append(Finding("objects-failed", values))
    if count[NOT_TRUSTED]:
        names = [row["name"] for row in rows if row["status"] == NOT_TRUSTED]
        values = {"count": count[NOT_TRUSTED], "objects": n_objects, "names": _few(names)}
        against.append(Finding("objects-not-trusted", values))
    if len(rows) < n_objects:
        values = {"count": n_objects - len(rows), "objects": n_objects}
        against.append(Finding("objects-not-done", values))
    content: BatchNumbers = {
        "catalogue": str(catalogue),
        "n_objects": n_objects,
        "n_trusted": count[TRUSTED],
        "n_not_trusted": count[NOT_TRUSTED],
        "n_failed": count[FAILED],
        "n_done_before": reused,
        "seconds": seconds,
        "objects_per_hour": 3600.0 * new / seconds if new else None,
        "workers": who,
        "objects": [dict(row) for row in rows],
    }
    return content, against


def _few(names: Sequence[str], most: int = 8) -> str:
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more
