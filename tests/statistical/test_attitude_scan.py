"""Attitude scans on a Dask cluster: the same ranking, and nothing lost with a worker."""

from __future__ import annotations

import os
import threading

import numpy as np
import pytest

from lcbayes.core import cluster as workers
from lcbayes.core.checkpoint import Checkpoint
from lcbayes.core.progress import Silent
from lcbayes.inversion.attitude_scan import search
from lcbayes.inversion.attitude_scan.grid import grid
from lcbayes.inversion.attitude_scan.points import Points
from lcbayes.inversion.attitude_scan.smooth import SmoothBody
from tests.helpers import spinning_bodies

POLE = np.array([0.48, -0.6, 0.64])
NOTHING = Checkpoint(None, {})


class Killer:
    """Progress that kills a process once half of the work is done."""

    def __init__(self, pid: int, after: int) -> None:
        self.pid, self.after, self.done = pid, after, False

    def advance(self, n: int, note: str = "") -> None:  # noqa: ARG002
        self.after -= n
        if self.after <= 0 and not self.done:
            self.done = True
            threading.Thread(target=os.kill, args=(self.pid, 9)).start()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of a worker that dies
def test_a_killed_worker_loses_no_hypothesis():
    distributed = pytest.importorskip("distributed")
    curve = spinning_bodies.observed(spinning_bodies.geometry(days=60.0), POLE, 5.0, 0.01)
    points = Points.of(curve, phase_law_known=False)
    body = SmoothBody.of(100, 3, spinning_bodies.LAW)
    tried = grid(6, float(points.span), None, (4.9, 5.1))

    def screened(run, track):
        return search.screen(points, body, tried, run, NOTHING, "screen", track)

    with workers.worker_pool() as run, Silent().stage("", 1, "") as track:
        alone = screened(run, track)
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
    ) as cluster:
        with distributed.Client(cluster) as client:
            pids = client.run(os.getpid)
        with workers.worker_pool(scheduler=cluster.scheduler_address) as run:
            killer = Killer(min(pids.values()), tried.size // 2)
            together = screened(run, killer)
    assert killer.done
    for a, b in zip(alone, together, strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.slow
def test_an_empty_address_is_said(monkeypatch):
    pytest.importorskip("distributed")
    from lcbayes.core.errors import InputError

    monkeypatch.setattr(workers, "WAIT_S", 0.5)
    with pytest.raises(InputError, match="no Dask scheduler answers at tcp://127"):
        workers.worker_pool(scheduler="tcp://127.0.0.1:9").__enter__()
