"""Tasks, whoever does them: in threads, and by processes that die."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from lcbayes.core import cluster
from lcbayes.core.cluster import object_pool, worker_pool
from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax


def halve(shared: float, x: int) -> float:
    if x == 3:
        raise ValueError(x)
    return shared * x


def test_a_task_that_fails_is_raised_or_returned_as_asked():
    tasks = [(i,) for i in range(6)]
    with worker_pool(keep_going=True) as run:
        done = dict(run(halve, 0.5, tasks))
    assert isinstance(done.pop(3), ValueError)
    assert done == {i: 0.5 * i for i in (0, 1, 2, 4, 5)}
    with worker_pool() as run, pytest.raises(ValueError, match="3"):
        dict(run(halve, 0.5, tasks))


def die(shared: str, x: int) -> int:
    """Task 1 kills its worker once, task 2 each time."""
    seen = Path(shared) / str(x)
    if x == 2 or (x == 1 and not seen.exists()):
        seen.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return x


def test_a_task_is_done_again_when_its_worker_dies_but_not_for_ever(tmp_path):
    pytest.importorskip("distributed")
    with worker_pool(n_workers=1, deaths=1, keep_going=True) as run:
        done = dict(run(die, str(tmp_path), [(i,) for i in range(4)]))
    assert type(done.pop(2)).__name__ == "KilledWorker"
    assert done == {i: i for i in (0, 1, 3)}


def test_a_result_that_is_lost_when_another_task_kills_its_worker_is_computed_again():
    """Computed again by Dask beside that task, it seems to have killed the worker itself."""
    scheduler = pytest.importorskip("distributed.scheduler")

    def result() -> None:
        raise scheduler.KilledWorker("task", None, 2)

    done = SimpleNamespace(status="finished", result=result)
    lost = cluster._outcome(done, keep_going=True, last=False, gone=cluster._gone())
    assert lost is cluster._LOST


WITHOUT = """
import sys
sys.modules["lcbayes"] = None
from distributed.cli.dask_worker import main
main([sys.argv[1], "--no-nanny", "--no-dashboard"])
"""


def test_workers_without_lcbayes_are_reported():
    """They would wait for tasks that they cannot read, and the user for them."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(n_workers=0, dashboard_address=":0", silence_logs=50) as local:
        address = local.scheduler_address
        worker = subprocess.Popen(
            [sys.executable, "-c", WITHOUT, address], stderr=subprocess.DEVNULL
        )
        try:
            refused = pytest.raises(
                InputError, match="1 of the 1 Dask workers cannot import lcbayes"
            )
            with refused, worker_pool(scheduler=address):
                pass
        finally:
            worker.kill()
            worker.wait()


def saved(folder: str, name: str) -> str:
    import xarray as xr

    from lcbayes.results.posterior import save_tree

    save_tree(xr.DataTree(xr.Dataset({"x": ("draw", [1.0, 2.0])})), Path(folder) / name)
    return name


def test_a_worker_of_a_cluster_writes_its_results(tmp_path):
    pytest.importorskip("distributed")
    with worker_pool(n_workers=1) as run:
        assert dict(run(saved, str(tmp_path), [("posterior.nc",)])) == {0: "posterior.nc"}
    assert (tmp_path / "posterior.nc").stat().st_size > 1000


@pytest.mark.slow
def test_a_cluster_that_goes_is_reported_in_a_line():
    distributed = pytest.importorskip("distributed")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = "tcp://{}:{}".format(*free.getsockname())
    place = ["--host", "127.0.0.1", "--port", address.rpartition(":")[2]]
    begin = [sys.executable, "-m"]
    scheduler, worker = (
        subprocess.Popen([*begin, *words, "--no-dashboard"], stderr=subprocess.DEVNULL)
        for words in (
            ("distributed.cli.dask_scheduler", *place),
            ("distributed.cli.dask_worker", address, "--no-nanny", "--nthreads", "1"),
        )
    )
    done = []

    def work() -> None:
        with worker_pool(scheduler=address) as run:
            for i, _ in run(slowly, 0.2, [(i,) for i in range(50)]):
                done.append(i)
                distributed.default_client()._timeout = 0.5  # for the scheduler to come back
                scheduler.kill()

    try:
        with pytest.raises(InputError, match="tasks were not done: the Dask cluster has gone"):
            work()
    finally:
        for process in (scheduler, worker):
            process.kill()
            process.wait()
    assert 0 < len(done) < 50


def slowly(seconds: float, x: int) -> int:
    time.sleep(seconds)
    return x


def squared(base: int, number: int) -> int:
    return base + number * number


@pytest.mark.parametrize("n_workers", [None, pytest.param(1, marks=pytest.mark.slow)])
def test_tasks_are_taken_as_they_are_needed(n_workers, monkeypatch):
    monkeypatch.setattr("os.cpu_count", lambda: 1)
    taken, done = [], []

    def tasks():
        for i in range(60):
            taken.append(i)
            yield (i,)

    with worker_pool(n_workers=n_workers, ahead=5) as run:
        for i, result in run(squared, 3, tasks()):
            done.append((i, result))
            assert len(taken) <= len(done) + 5
    assert sorted(done) == [(i, 3 + i * i) for i in range(60)]


def test_processes_do_not_share_an_accelerator(monkeypatch):
    """Each would take most of its memory."""
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    with object_pool(None, None, 8) as (pool, who):
        assert who == "threads of one process (they share the gpu)"
        assert {process for _, process in pool(process_of, None, [()] * 8)} == {os.getpid()}
    monkeypatch.undo()
    with object_pool(None, None, 2) as (_, who):
        assert who in ("1 process of this machine", "2 processes of this machine")


def process_of(_: None) -> int:
    return os.getpid()
