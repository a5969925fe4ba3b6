"""What every result says of itself: a summary that opens with whether it may be trusted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from lcbayes.core.files import write_atomic
from lcbayes.core.toml import to_toml


class Judged:
    """A result with its summary, whose ``converged`` and ``reasons`` are its verdict, and the
    settings that give it again."""

    def __init__(self, summary: dict[str, Any], run: Mapping[str, Any]) -> None:
        self._summary = summary
        self._run = dict(run)

    @property
    def converged(self) -> bool:
        return self._summary["converged"]

    @property
    def reasons(self) -> list[str]:
        """Why the result must not be trusted, in words; empty where it may be."""
        return self._summary["reasons"]

    def summary(self) -> dict[str, Any]:
        """The content of the summary file."""
        return self._summary

    def _write(self, folder: Path, name: str) -> None:
        from lcbayes.core.files import write_json

        write_json(self._summary, folder / name)
        write_atomic(
            folder / "run.toml", lambda p: p.write_text(to_toml(self._run), encoding="utf-8")
        )


def told(reasons: list[str]) -> str:
    """A verdict against a result as lines on a terminal."""
    return "\n".join(["DO NOT TRUST THIS RESULT:", *(f"  - {reason}" for reason in reasons)])


def agreed(weights: Sequence[float]) -> str:
    """What a trusted fit says first, from the weights of its solutions."""
    if len(weights) == 1:
        return "One solution explains the data; the chains agree on it."
    if max(weights) > 0.99:
        return "One solution holds nearly all the weight; the chains of each agree."
    return f"{len(weights)} solutions explain the data; the chains of each agree."
