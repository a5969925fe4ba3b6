"""Parallel execution on the cores of this process or on the workers of a Dask cluster.

Tasks are pure functions of their arguments. A task whose worker is lost is therefore repeated,
and the results depend neither on the type nor on the number of workers.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError, as_completed
from contextlib import contextmanager, suppress
from functools import partial
from importlib import import_module
from pkgutil import resolve_name
from typing import Any

from lcbayes.core.errors import InputError
from lcbayes.core.threads import threads

MAX_ATTEMPTS = 5  # at a task whose workers die
MAX_INLINE_BYTES = 10_000  # shared arguments up to this size are sent with each task
MAX_WORKER_DEATHS = 100  # during one task, before the task is abandoned
WAIT_S = 30.0  # waiting time for the first worker of a cluster

# (function, shared argument, tasks) -> index and result of each task
type Run = Callable[[Callable[..., Any], Any, Sequence[tuple]], Iterator[tuple[int, Any]]]


@contextmanager
def worker_pool(
    scheduler: str | None = None,
    n_workers: int | None = None,
    *,
    deaths: int = MAX_WORKER_DEATHS,
    keep_going: bool = False,
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

    Raises
    ------
    InputError
        If Dask is not installed, or no scheduler or worker responds.
    """
    if scheduler is None and n_workers is None:
        yield lambda function, shared, tasks: _threads(function, shared, tasks, keep_going)
        return
    if scheduler is not None and n_workers is not None:
        raise InputError("--scheduler and --workers are both given; a cluster has its own workers")
    if n_workers is not None and n_workers < 1:
        raise InputError(f"--workers is {n_workers}; give a whole number >= 1")
    with _client(scheduler, n_workers, deaths) as client:
        yield lambda function, shared, tasks: _dask(client, function, shared, tasks, keep_going)


def _threads(
    function: Callable[..., Any], shared: Any, tasks: Sequence[tuple], keep_going: bool
) -> Iterator[tuple[int, Any]]:
    with threads(os.cpu_count() or 1) as pool:
        waiting = {pool.submit(function, shared, *task): i for i, task in enumerate(tasks)}
        try:
            for done in as_completed(waiting):
                fault = done.exception() if keep_going else None
                yield waiting[done], done.result() if fault is None else fault
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


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
    tasks: Sequence[tuple],
    keep_going: bool,
) -> Iterator[tuple[int, Any]]:
    """Run tasks on a cluster.

    A large shared argument is sent to every worker once, a small one with each task. If the last
    copy or a result is lost with its workers, the argument is sent again together with the
    remaining tasks, as long as the scheduler exists.
    """
    done_by_dask = import_module("distributed").as_completed
    gone = (import_module("distributed.client").ClosedClientError, OSError)
    little = import_module("dask.sizeof").sizeof(shared) < MAX_INLINE_BYTES
    left = dict(enumerate(tasks))
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
        except gone:
            break
        try:
            for done in done_by_dask(waiting):
                i = waiting[done]
                outcome = _outcome(done, keep_going, attempt == MAX_ATTEMPTS - 1, gone)
                if outcome is not _LOST:
                    del left[i]
                    yield i, outcome
        finally:
            with suppress(*gone):
                client.cancel(list(waiting))
        if not left:
            return
    lost = "lost its workers again and again" if client.status == "running" else "has gone"
    fault = InputError(
        f"{len(left)} tasks were not done: the Dask cluster {lost}; start it again, or do without, "
        "and give the same command again"
    )
    if not keep_going:
        raise fault
    yield from ((i, fault) for i in left)
