"""`lcbayes.batch`: a fit of every object of a catalogue, for Python."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from contextlib import AbstractContextManager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from lcbayes.core.cluster import Run, worker_pool
from lcbayes.core.files import write_atomic
from lcbayes.core.progress import Silent
from lcbayes.core.version import installed_version
from lcbayes.results import catalogue as table
from lcbayes.results.folder import alone_in, made_aside, make_folder
from lcbayes.results.verdict import Judged
from lcbayes.tasks.batch import worker
from lcbayes.tasks.batch.objects import Object, objects

DEATHS = 3  # workers that may die of one object
WRITTEN = ("batch.json", "objects.csv", "run.toml", "batch.html")
PAGE = ("batch.html", "figures/batch.png")


class Batch(Judged):
    """The rows of many objects; `summary` is the content of ``batch.json``."""

    @property
    def rows(self) -> list[dict[str, Any]]:
        """One for each object, in the order of the catalogue."""
        return self._summary["objects"]

    def save(self, folder: str | Path) -> Path:
        """Write batch.json, objects.csv and run.toml; the page of an earlier result goes."""
        folder = make_folder(folder)
        with made_aside(folder, PAGE) as aside:
            self._write(aside, "batch.json")
            write_atomic(
                aside / "objects.csv",
                lambda p: p.write_text(table.to_csv(self.rows), encoding="utf-8"),
            )
        return folder

    def report(self, folder: str | Path) -> Path:
        """Write everything `save` does, the figure and the page."""
        from lcbayes.analysis import batch_page

        return batch_page.write(self.save(folder), self._summary, self._run)

    def __repr__(self) -> str:
        s = self._summary
        counts = ", ".join(
            f"{s[f'n_{k}']} {k.replace('_', ' ')}" for k in ("trusted", "not_trusted", "failed")
        )
        return f"Batch({s['n_objects']} objects: {counts})"


def batch(
    catalogue: str | Path,
    *,
    out: str | Path,
    common: Mapping[str, Any] | None = None,
    scheduler: str | None = None,
    workers: int | None = None,
    reports: bool = False,
    progress: Silent | None = None,
) -> Batch:
    """Fit every object of a catalogue, each into a folder of its own under ``out/objects``.

    An object that fails is named with its reason, and the others are done. Objects that an earlier
    run did with the same files and options are not done again; one that was cut off goes on from
    its checkpoint; one that failed is tried again.

    Parameters
    ----------
    catalogue : path
        CSV, TOML, a folder or a pattern; see `lcbayes.tasks.batch.objects.objects`.
    out : path
    common : mapping, optional
        What every object takes that does not say otherwise: how it is read, keywords of
        `lcbayes.fit`, options of the model.
    scheduler : str, optional
        Address of a Dask scheduler, whose workers see the same files under the same paths.
    workers : int, optional
        Processes of this machine; as many as it has cores unless given. Without Dask the objects
        are done by threads of this process.
    reports : bool
        Write the page of every object, too.

    Raises
    ------
    InputError
        The catalogue or an option is at fault.

    Examples
    --------
    >>> found = lcbayes.batch("night.csv", out="night", common={"n_facets": 2})   # doctest: +SKIP
    >>> found.rows[0]["status"]                                                   # doctest: +SKIP
    """
    progress = progress or Silent()
    asked = objects(catalogue, common)
    _check(asked)
    run = {
        "catalogue": os.path.abspath(catalogue),
        "options": {k: v for k, v in (common or {}).items() if v is not None},
        "version": installed_version(),
    }
    with alone_in(out, WRITTEN) as folder:
        assert folder is not None
        where = make_folder(folder / "objects").resolve()
        done = {i: worker.done_before(where / one.name, one) for i, one in enumerate(asked)}
        rows = {i: row for i, row in done.items() if row is not None}
        left = [i for i in range(len(asked)) if i not in rows]
        reused = len(rows)
        if reused:
            progress.say(f"{reused} of {len(asked)} objects are done already")
        begun = time.monotonic()
        crew_of, who = _crew(scheduler, workers, len(left))

        def found() -> Batch:
            told = [rows[i] for i in sorted(rows)]
            seconds = time.monotonic() - begun
            said = table.summarise(catalogue, told, len(asked), reused, seconds, who)
            return Batch(said, run)

        try:
            if left:
                with (
                    crew_of as fitted,
                    progress.stage("objects", len(left), "objects") as track,
                ):
                    tasks = [(asked[i],) for i in left]
                    for k, row in fitted(worker.fit_object, (str(where), reports), tasks):
                        i = left[k]
                        rows[i] = _dead(asked[i], row) if isinstance(row, BaseException) else row
                        track.advance(1, f"{rows[i]['name']} {rows[i]['status']}")
        finally:  # also where it was interrupted
            result = found()
            if rows:
                result.save(folder)
    return result


def _check(asked: list[Object]) -> None:
    """Options and settings of all objects, before the first is begun."""
    from lcbayes.modelling import registry
    from lcbayes.samplers.settings import Settings

    for one in asked:
        entry = registry.find(one.keywords.get("model", "faceted"))
        entry.check(one.options)
        Settings(**{k: v for k, v in one.keywords.items() if k not in ("model", "start_from")})


def _crew(
    scheduler: str | None, workers: int | None, n: int
) -> tuple[AbstractContextManager[Run], str]:
    """Who does it, and that in words."""
    if scheduler is not None:
        return worker_pool(scheduler, workers, keep_going=True), f"Dask cluster {scheduler}"
    if workers is None and find_spec("distributed") is None:
        return worker_pool(keep_going=True), "threads of one process (Dask is not installed)"
    count = workers if workers is not None else max(1, min(os.cpu_count() or 1, n))
    return (
        worker_pool(n_workers=count, deaths=DEATHS, keep_going=True),
        f"{count} process{'es' if count > 1 else ''} of this machine",
    )


def _dead(one: Object, fault: BaseException) -> dict[str, Any]:
    if type(fault).__name__ == "KilledWorker":
        return worker.failed(
            one, f"{DEATHS + 1} workers died of it: too little memory, or a fault of a library"
        )
    return worker.failed(one, f"{type(fault).__name__}: {fault}")
