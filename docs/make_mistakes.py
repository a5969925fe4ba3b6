"""Write `mistakes.md`: what lcbayes says about usual mistakes; run it after a change of a message.

python docs/make_mistakes.py
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from tests.helpers.mistakes import MISTAKES, Answer, answers  # noqa: E402

INTRODUCTION = """\
# Usual mistakes

What lcbayes says about {number} usual mistakes. If it refuses, it prints one line, writes nothing,
and its exit status is 2. If a value is possible but unlikely, it runs and prints a note, which the
report repeats. `look` is the quickest way to see the notes about a file.
"""


def page(answered: Mapping[str, Answer]) -> str:
    """The page in Markdown."""
    parts = [INTRODUCTION.format(number=len(answered))]
    for group, mistakes in MISTAKES.items():
        parts.append(f"\n## {group}\n")
        for mistake in mistakes:
            message = "note: " * mistake.noticed + answered[mistake.what].message
            for mark in "\\_*<":
                message = message.replace(mark, f"\\{mark}")
            parts.append(f"\n**{mistake.what}.** `$ lcbayes {mistake.command}`\n\n> {message}\n")
    return "".join(parts)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        text = page(answers(Path(folder)))
    (ROOT / "docs" / "mistakes.md").write_text(text, encoding="utf-8")
