"""Parallel execution on the cores of this process or on the workers of a Dask cluster.

Tasks are pure functions of their arguments. A task whose worker is lost is therefore repeated,
and the results depend neither on the type nor on the number of workers.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from itertools import islice
from pkgutil import resolve_name
from queue import SimpleQueue
from typing import Any

import numpy as np

from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax
from lcbayes.core.threads import threads

MAX_ATTEMPTS = 5  # at a task whose workers die
MAX_INLINE_BYTES = 10_000  # shared arguments up to this size are sent with each task
MAX_WORKER_DEATHS = 100  # during one task, before the task is abandoned
WAIT_S = 30.0  # waiting time for the first worker of a cluster
DEATHS = 3  # workers that one of many independent objects may crash

# (function, shared argument, tasks) -> index and result of each task
type Run = Callable[[Callable[..., Any], Any, Iterable[tuple]], Iterator[tuple[int, Any]]]


@contextmanager
def worker_pool(
    scheduler: str | None = None,
    n_workers: int | None = None,
    *,
    deaths: int = MAX_WORKER_DEATHS,
    keep_going: bool = False,
    ahead: int | None = None,
) -> Iterator[Run]:
    """Context manager that provides a function ``run(function, shared, tasks)``.

    It yields (index, function(shared, *task)) for each task as it completes, in any
    order.

    Parameters
    ----------
    scheduler : str, optional
        Address of a Dask scheduler, e.g. ``tcp://host:8786``; lcbayes must be installed on its
        workers.
    n_workers : int, optional
        Number of processes of a local Dask cluster to start. Without ``scheduler`` and
        ``n_workers`` the tasks run in threads of this process.
    deaths : int
        Number of workers of a local cluster that may die during a task before the task is
        abandoned. Until then it is repeated on another worker, because it may not have caused the
        death.
    keep_going : bool
        Yield the exception of a failed task in place of its result, instead of raising it.
    ahead : int, optional
        Number of tasks for each worker that are taken from ``tasks`` before their results have been
        yielded; by default all. With a limit, neither the tasks nor their results are all held in
        memory. If the cluster is lost, an InputError is then raised in any case.

    Raises
    ------
    InputError
        If Dask is not installed, or no scheduler or worker responds.
    """
    if scheduler is None and n_workers is None:
        yield partial(_threads, keep_going=keep_going, ahead=ahead)
        return
    if scheduler is not None and n_workers is not None:
        raise InputError("--scheduler and --workers are both given; a cluster has its own workers")
    if n_workers is not None and n_workers < 1:
        raise InputError(f"--workers is {n_workers}; give a whole number >= 1")
    with _client(scheduler, n_workers, deaths) as client:
        yield partial(_dask, client, keep_going=keep_going, ahead=ahead)


@contextmanager
def object_pool(
    scheduler: str | None, n_workers: int | None, most: int, ahead: int | None = None
) -> Iterator[tuple[Run, str]]:
    """The pool for many independent objects, which goes on after faults, and its description.

    Without options, a local Dask cluster has a process for each core, but at most ``most``. The
    threads of this process are used without Dask, and on an accelerator, whose memory processes do
    not share.
    """
    given = {"keep_going": True, "ahead": ahead}
    if scheduler is not None:
        with worker_pool(scheduler, n_workers, **given) as run:
            yield run, f"Dask cluster {scheduler}"
    elif n_workers is None and (reason := _reason_for_threads()):
        with worker_pool(**given) as run:
            yield run, f"threads of one process ({reason})"
    else:
        count = n_workers if n_workers is not None else max(1, min(os.cpu_count() or 1, most))
        with worker_pool(n_workers=count, deaths=DEATHS, **given) as run:
            yield run, f"{count} process{'es' if count > 1 else ''} of this machine"


def _reason_for_threads() -> str:
    if find_spec("distributed") is None:
        return "Dask is not installed"
    device = jax.default_backend()
    return "" if device == "cpu" else f"they share the {device}"


def _threads(
    function: Callable[..., Any],
    shared: Any,
    tasks: Iterable[tuple],
    keep_going: bool,
    ahead: int | None,
) -> Iterator[tuple[int, Any]]:
    n = os.cpu_count() or 1
    source, waiting, finished = enumerate(tasks), {}, SimpleQueue()
    with threads(n) as pool:
        try:
            while True:
                for i, task in islice(source, _free(ahead, n, len(waiting))):
                    waiting[new := pool.submit(function, shared, *task)] = i
                    new.add_done_callback(finished.put)
                if not waiting:
                    return
                done = finished.get()
                i, fault = waiting.pop(done), done.exception() if keep_going else None
                yield i, done.result() if fault is None else fault
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def _free(ahead: int | None, n_workers: int, waiting: int) -> int | None:
    """How many more tasks may be submitted; None for all."""
    return None if ahead is None else max(ahead * n_workers - waiting, 0)


def without_cluster() -> AbstractContextManager[Any]:
    """Disable the lock by file name that xarray takes across the cluster on a Dask worker; a file
    in memory has no name."""
    dask = sys.modules.get("dask")
    return nullcontext() if dask is None else dask.config.set(scheduler="threads")


@contextmanager
def _client(scheduler: str | None, n_workers: int | None, deaths: int) -> Iterator[Any]:
    try:
        distributed = import_module("distributed")  # not in every environment
        configured = import_module("dask.config").set
    except ImportError:
        raise InputError(
            "Dask is not installed; it comes with pip install 'lcbayes[dask]'"
        ) from None
    # one task at a time per worker, so that a death is attributed to the right task
    settings = {
        "distributed.scheduler.allowed-failures": deaths,
        "distributed.scheduler.worker-saturation": 1.0,
    }
    with configured(settings):
        if scheduler is None:
            with (
                distributed.LocalCluster(
                    n_workers=n_workers,
                    threads_per_worker=1,
                    processes=True,
                    dashboard_address=":0",
                    silence_logs=50,
                ) as cluster,
                distributed.Client(cluster) as client,
            ):
                yield client
            return
        try:
            client = distributed.Client(scheduler, timeout=WAIT_S)
        except (OSError, ValueError, TimeoutError) as fault:
            raise InputError(
                f"no Dask scheduler answers at {scheduler} ({str(fault) or 'timeout'}); start one "
                "with dask scheduler, or leave --scheduler out"
            ) from None
        with client:
            try:
                client.wait_for_workers(1, timeout=WAIT_S)
            except TimeoutError:
                raise InputError(
                    f"the Dask scheduler at {scheduler} has no workers; start one with "
                    f"dask worker {scheduler}"
                ) from None
            _require_lcbayes(client)
            yield client


def _require_lcbayes(client: Any) -> None:
    """Raise InputError unless every worker can import lcbayes; otherwise tasks fail silently."""
    imported = client.run(resolve_name, f"{InputError.__module__}:InputError", on_error="return")
    without = [address for address, what in imported.items() if what is not InputError]
    if without:
        raise InputError(
            f"{len(without)} of the {len(imported)} Dask workers cannot import lcbayes "
            f"({without[0]}); install it in their environment"
        )


def _gone() -> tuple[type[Exception], ...]:
    """What is raised where the cluster, or a result that was there before, is lost.

    Dask computes a lost result again, perhaps beside a task that kills its worker, and then blames
    the result's task for that death.
    """
    client, scheduler = (import_module(f"distributed.{name}") for name in ("client", "scheduler"))
    return client.ClosedClientError, scheduler.KilledWorker, OSError


_LOST = object()  # in place of a result that was lost with its worker


def _outcome(done: Any, keep_going: bool, last: bool, gone: tuple[type[Exception], ...]) -> Any:
    """The result of a task, its exception if ``keep_going``, or `_LOST` if it must be repeated."""
    if done.status == "error" and keep_going:
        return done.exception()
    if done.status == "error" and last:
        done.result()  # raises
    if done.status != "finished":
        return _LOST
    try:
        return done.result()
    except (CancelledError, *gone):
        return _LOST


def _dask(
    client: Any,
    function: Callable[..., Any],
    shared: Any,
    tasks: Iterable[tuple],
    keep_going: bool,
    ahead: int | None,
) -> Iterator[tuple[int, Any]]:
    """Run tasks on a cluster.

    A large shared argument is sent to every worker once, a small one with each task. If the last
    copy or a result is lost with its workers, the argument is sent again together with the
    remaining tasks, as long as the scheduler exists.
    """
    done_by_dask = import_module("distributed").as_completed
    gone = _gone()
    little = import_module("dask.sizeof").sizeof(shared) < MAX_INLINE_BYTES
    supply = _Supply(client, tasks, ahead)
    left: dict[int, tuple] = {}  # submitted, and not done
    for attempt in range(MAX_ATTEMPTS):
        try:
            common = (
                shared
                if little
                else client.scatter(shared, broadcast=True, direct=False, hash=False)
            )
            # earlier tasks first, so that results plotted during the run appear in order
            submit = partial(client.submit, function, common, pure=False, retries=MAX_ATTEMPTS)
            waiting = {submit(*task, priority=-i): i for i, task in left.items()}
            waiting |= supply.more(submit, left)
        except gone:
            break
        try:
            queue = done_by_dask(waiting)
            for done in queue:
                i = waiting.pop(done)
                outcome = _outcome(done, keep_going, attempt == MAX_ATTEMPTS - 1, gone)
                if outcome is not _LOST:
                    del left[i]
                    yield i, outcome
                with suppress(*gone):  # the next attempt finds out
                    new = supply.more(submit, left)
                    waiting |= new
                    queue.update(new)
        finally:
            with suppress(*gone):
                client.cancel(list(waiting))
        if not left:
            return
    if ahead is None:
        left |= dict(supply.source)
    lost = "lost its workers again and again" if client.status == "running" else "has gone"
    fault = InputError(
        f"{len(left)} tasks were not done: the Dask cluster {lost}; start it again, or do without, "
        "and give the same command again"
    )
    if not keep_going or ahead is not None:
        raise fault
    yield from ((i, fault) for i in left)


class _Supply:
    """Submits tasks to a cluster until ``ahead`` for each worker are not done."""

    def __init__(self, client: Any, tasks: Iterable[tuple], ahead: int | None) -> None:
        self.client, self.source, self.ahead = client, enumerate(tasks), ahead
        self.counted, self.n_workers = -np.inf, 1

    def free(self, waiting: int) -> int | None:
        """How many more tasks may be submitted; the workers are counted once a second."""
        now = time.monotonic()
        if self.ahead is not None and now - self.counted > 1.0:
            self.counted, self.n_workers = now, max(len(self.client.nthreads()), 1)
        return _free(self.ahead, self.n_workers, waiting)

    def more(self, submit: Callable[..., Any], left: dict[int, tuple]) -> dict[Any, int]:
        """The futures of further tasks, which are added to ``left``, with their numbers."""
        new = {}
        for i, task in islice(self.source, self.free(len(left))):
            left[i] = task
            new[submit(*task, priority=-i)] = i
        return new
