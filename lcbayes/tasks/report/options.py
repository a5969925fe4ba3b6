"""Options of `lcbayes report`."""

from __future__ import annotations

from dataclasses import dataclass

from lcbayes.core.options import Options
from lcbayes.tasks.task import SOURCE, Task


@dataclass(frozen=True)
class ReportOptions(Options):
    """`lcbayes.report` has no options of its own."""


TASK = Task(
    name="report",
    details="""\
example:
  lcbayes report out

For folders of fit, scan, compare and batch; the folder alone is read. The exit status
is 3 where the result must not be trusted.
""",
    options=ReportOptions,
    source="folder",
    source_help="folder of a fit, a scan, a comparison or a batch",
    out=SOURCE,
)
