"""Options of `lcbayes models`."""

from __future__ import annotations

from dataclasses import dataclass

from lcbayes.core.options import Options, option
from lcbayes.tasks.task import TEXT, Task


@dataclass(frozen=True)
class ModelsOptions(Options):
    """Options of `lcbayes models`."""

    name: str | None = option(None, positional=True, help="a model, or a file with one")
    contract: bool = option(False, help="print what a model file must define")


TASK = Task(
    name="models",
    details="""\
examples:
  lcbayes models
  lcbayes models faceted
  lcbayes models ./mine.py        # checks a file of your own
  lcbayes models --contract       # what such a file must define
""",
    options=ModelsOptions,
    source="",
    out=TEXT,
)
