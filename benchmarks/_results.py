"""One section per benchmark in RESULTS.md, replaced when the benchmark runs again."""

from __future__ import annotations

import datetime
import os
import re
from pathlib import Path

RESULTS = Path(__file__).with_name("RESULTS.md")
HEADER = (
    "# Results\n\nEach section is written by the command it names; run that to measure again.\n"
)


def table(columns: list[str], rows: list[list[str]]) -> str:
    """A Markdown table."""
    lines = [columns, ["---"] * len(columns), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def write_section(title: str, command: str, text: str, results: Path = RESULTS) -> None:
    """Write a section under its title, replacing an earlier one, with command, cores and date."""
    when = datetime.datetime.now(tz=datetime.UTC).date().isoformat()
    stamp = f"`{command}` · {os.cpu_count()} cores · {when}"
    section = f"## {title}\n{stamp}\n\n{text.strip()}\n"
    old = results.read_text(encoding="utf-8") if results.exists() else HEADER
    parts = re.split(r"(?m)^(?=## )", old)
    kept = [p.strip() + "\n" for p in parts]
    at = next((i for i, p in enumerate(kept) if p.splitlines()[0] == f"## {title}"), len(kept))
    kept[at : at + 1] = [section]
    results.write_text("\n".join(kept), encoding="utf-8")
