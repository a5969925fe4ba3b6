"""`lcbayes.batch`."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from lcbayes.core.cluster import DEATHS, object_pool
from lcbayes.modelling import registry
from lcbayes.results import catalogue as table
from lcbayes.results.reasons import reasons
from lcbayes.tasks.batch import worker
from lcbayes.tasks.batch.objects import Object, objects
from lcbayes.tasks.batch.options import TASK, BatchOptions
from lcbayes.tasks.batch.result import Batch
from lcbayes.tasks.task import Context, recorded, task_function


@task_function(TASK)
def batch(catalogue: str | Path, options: BatchOptions, context: Context) -> Batch:
    """Fit every object of a catalogue, each in a separate folder under ``out/objects``.

    If an object fails, it is listed with the reason and the other objects are still fitted. Objects
    already fitted with the same files and options are not fitted again, an interrupted fit resumes
    from its checkpoint, and a failed one is repeated.

    {parameters}

    Returns
    -------
    Batch
        ``summary()`` has one row per object.

    Raises
    ------
    InputError
        The catalogue or an option is invalid.

    Examples
    --------
    >>> import lcbayes
    >>> import tempfile
    >>> folder = tempfile.mkdtemp()
    >>> curve = lcbayes.simulate("one-facet", seed=1, out=f"{folder}/one.csv").data
    >>> few = dict(num_starts=8, num_warmup=10, num_samples=10, num_chains=2)
    >>> result = lcbayes.batch(f"{folder}/*.csv", n_facets=1, spin="none", workers=1,
    ...     out=f"{folder}/night", **few)
    >>> list(result.summary()["status"])    # 20 draws are too few
    ['not trusted']
    """
    assert context.folder is not None
    asked = objects(catalogue, _common(options))
    _check(asked)
    where = context.folder.path / "objects"
    where.mkdir(exist_ok=True)
    where = where.resolve()
    done = {i: worker.done_before(where / one.name, one) for i, one in enumerate(asked)}
    rows = {i: row for i, row in done.items() if row is not None}
    left = [i for i in range(len(asked)) if i not in rows]
    reused = len(rows)
    if reused:
        context.progress.say(f"{reused} of {len(asked)} objects are done already")
    begun = time.monotonic()
    who = ""

    def result() -> Batch:
        of_rows = [rows[i] for i in sorted(rows)]
        seconds = time.monotonic() - begun
        content, against = table.summarise(catalogue, of_rows, len(asked), reused, seconds, who)
        return Batch(content, reasons(against), {})

    try:
        if left:
            with (
                object_pool(options.scheduler, options.workers, len(left)) as (fitted, who),
                context.progress.stage("objects", len(left), "objects") as track,
            ):
                tasks = [(asked[i],) for i in left]
                for k, row in fitted(worker.fit_object, (str(where), options.reports), tasks):
                    i = left[k]
                    rows[i] = _dead(asked[i], row) if isinstance(row, BaseException) else row
                    track.advance(1, f"{rows[i]['name']} {rows[i]['status']}")
    except BaseException:  # interrupted: finished objects are kept
        if rows:
            recorded(TASK, result(), options, catalogue).write(context.folder, report=False)
        raise
    return result()


def _common(options: BatchOptions) -> dict[str, Any]:
    """The default options of all objects."""
    own = ("reports", "scheduler", "workers")
    given = {name: value for name, value in options.as_dict().items() if name not in own}
    return {k: str(v) if isinstance(v, Path) else v for k, v in given.items()}


def _check(asked: Sequence[Object]) -> None:
    """Check the options and settings of all objects before the first fit."""
    for one in asked:
        entry = registry.find(one.options.model)
        given = dict(one.options.for_model)
        period = entry.options.get("period")
        if one.options.start_from is not None and period is not None and period.required:
            given.setdefault("period", 1.0)  # that of the scan
        entry.check(given)


def _dead(one: Object, fault: BaseException) -> dict[str, Any]:
    if type(fault).__name__ == "KilledWorker":
        return worker.failed(
            one, f"{DEATHS + 1} workers died of it: too little memory, or a fault of a library"
        )
    return worker.failed(one, f"{type(fault).__name__}: {fault}")
