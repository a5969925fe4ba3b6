"""Progress that keeps what is said."""

from __future__ import annotations

from lcbayes.core.progress import Silent


class Heard(Silent):
    """Keeps the lines that are said."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def say(self, text: str) -> None:
        self.lines.append(text)
