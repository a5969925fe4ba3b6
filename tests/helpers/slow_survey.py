"""A survey whose search only waits, for tests that kill its processes.

    python -m tests.helpers.slow_survey CATALOGUE OUT [WORKERS]

Objects named ``once`` and ``always`` kill the process that searches them: the first time, and each
time.
"""

from __future__ import annotations

import os
import signal
import sys
import time
from pathlib import Path
from typing import Any

import lcbayes
from lcbayes.core import cluster
from lcbayes.data.catalogues.entry import Entry
from lcbayes.tasks.survey import worker

WAIT_S = 0.15


def search(shared: tuple[Any, str], entry: Entry) -> dict[str, Any]:
    """One solution, whose period is the length of the text of the object."""
    folder = Path(shared[1]).parent
    time.sleep(WAIT_S)
    with (folder / "searched").open("a") as file:
        file.write(entry.name + "\n")
    if entry.name == "always" or (entry.name == "once" and not (folder / "killed").exists()):
        (folder / "killed").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    assert entry.file is not None
    period = float(len(entry.file.text))
    return {
        "name": entry.name,
        "status": "not trusted",
        "reasons": [],
        "retry": False,
        "seconds": WAIT_S,
        "n_obs": 120,
        "n_curves": 1,
        "span_days": 900.0,
        "frame": "icrs",
        "solutions": [[period, 0.1, 1.0, 2.0, 0.5, 0.4, 0.3, 0.1, None]],
    }


def main(catalogue: str, out: str, workers: str = "") -> lcbayes.Survey:
    worker.search_object = search
    if not workers:
        cluster.find_spec = lambda *_: None
    return lcbayes.survey(
        catalogue, out=out, workers=int(workers) if workers else None, report=False
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
