"""Options of `lcbayes doctor`."""

from __future__ import annotations

from dataclasses import dataclass

from lcbayes.core.options import Options, option
from lcbayes.tasks.task import TEXT, Task


@dataclass(frozen=True)
class DoctorOptions(Options):
    """Options of `lcbayes doctor`."""

    json: bool = option(False, help="print the answer as JSON")


TASK = Task(
    name="doctor",
    details="""\
example:
  lcbayes doctor
""",
    options=DoctorOptions,
    source="",
    out=TEXT,
)
