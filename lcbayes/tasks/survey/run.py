"""`lcbayes.survey`."""

from __future__ import annotations

import time
from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any

from lcbayes.core.cluster import DEATHS, object_pool
from lcbayes.core.errors import InputError
from lcbayes.core.progress import Track
from lcbayes.data.catalogues.entry import Entry
from lcbayes.data.catalogues.folder import Folder
from lcbayes.data.catalogues.opened import Catalogue
from lcbayes.data.catalogues.opened import catalogue as opened
from lcbayes.results import survey_table
from lcbayes.results.journal import Journal
from lcbayes.results.reasons import reasons
from lcbayes.tasks.survey import worker
from lcbayes.tasks.survey.options import TASK, SurveyOptions
from lcbayes.tasks.survey.result import Survey
from lcbayes.tasks.task import Context, recorded, task_function

JOURNAL = "objects.jsonl"
AHEAD = 4  # objects for each worker that are read before they are needed
TRIED = 5  # objects of a table that are read first; if none can be, the table is at fault


@task_function(TASK)
def survey(catalogue: str | Path, options: SurveyOptions, context: Context) -> Survey:
    """Search the periods and poles of every object of a catalogue of sparse points.

    Every object has the first stage of `lcbayes.scan`: all periods of a range with all poles, and a
    probability of each solution. The result is one table with a row for each object and solution.
    Objects are read one after another, so that a catalogue may be larger than the memory. If an
    object fails, its row has the reason. Objects that an earlier run finished with the same points
    and options are kept, even if that run was killed.

    {parameters}

    Returns
    -------
    Survey
        ``summary()`` has one row for each object and solution.

    Raises
    ------
    InputError
        The catalogue or an option is invalid, or the cluster is lost.

    References
    ----------
    Ďurech, Hanuš & Vančo 2018, A&A 617, A57.

    Examples
    --------
    >>> import lcbayes
    >>> import tempfile
    >>> from pathlib import Path
    >>> folder = Path(tempfile.mkdtemp())
    >>> rows = "".join(f"Ceres,{2460000.5 + 9 * k},3.3,1,0,0,1,0.1,0\\n" for k in range(6))
    >>> text = "object,jd,mag,sun_x,sun_y,sun_z,obs_x,obs_y,obs_z\\n" + rows
    >>> _ = (folder / "survey.csv").write_text(text, encoding="utf-8")
    >>> result = lcbayes.survey(folder / "survey.csv", workers=1, out=folder / "out")
    >>> result.summary()["reasons"][0]
    'there are 6 points; a period needs at least 10'
    """
    assert context.folder is not None
    source = opened(catalogue, options.object)
    for note in _notes_of_first(source, options):
        context.progress.say(f"note: {note}")
    if isinstance(source, Folder) and (others := source.left_out):
        context.progress.say(f"{len(others)} other files are left out, such as {others[0].name}")
    context.progress.say("counting the objects")
    run = _Run(source, options, context.folder.path, array("q", [-1]) * source.count())
    begun, who = time.monotonic(), ""

    def result() -> Survey:
        table = survey_table.of_journal(run.journal.path, run.places)
        seconds = time.monotonic() - begun
        content, against = survey_table.summarise(
            catalogue, table, len(run.places), run.reused, seconds, who
        )
        return Survey(content, reasons(against), {}, table)

    try:
        with (
            object_pool(options.scheduler, options.workers, len(run.places), AHEAD) as (pool, who),
            context.progress.stage("objects", len(run.places), "objects") as track,
        ):
            shared = options, str(context.folder.path.resolve())
            for number, row in pool(worker.search_object, shared, run.tasks(track)):
                run.keep(number, row, track)
    except BaseException:  # interrupted: finished objects are kept
        if any(place >= 0 for place in run.places):
            recorded(TASK, result(), options, catalogue).write(context.folder, report=False)
        raise
    finally:
        run.journal.close()
    if run.unseen:
        context.progress.say(f"--full: no object is called {' or '.join(sorted(run.unseen))}")
    return result()


def _notes_of_first(source: Catalogue, options: SurveyOptions) -> Sequence[str]:
    """How the first object of a table was read, which says what its columns were taken for.

    A table of which none of the first objects can be read is refused.

    Raises
    ------
    InputError
        The reason is that of the first.
    """
    if isinstance(source, Folder):
        return ()
    faults: list[InputError] = []
    for entry in islice(source.objects(), TRIED):
        try:
            notes = worker.light_curve(entry, options).source.get("notes", "")
            return list(filter(None, notes.split("; ")))
        except InputError as fault:
            faults.append(fault)
    if faults:
        raise faults[0]
    return ()


@dataclass
class _Run:
    """The objects of a catalogue, those that are done, and those that are being computed.

    Attributes
    ----------
    places : place in the journal of each object of the catalogue; −1 if it is not done
    unseen : names of `--full` that have not occurred
    """

    source: Catalogue
    options: SurveyOptions
    folder: Path
    places: array[int]
    reused: int = 0
    unseen: set[str] = field(init=False)
    journal: Journal = field(init=False)
    _waiting: dict[int, tuple[int, str, str]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.journal = Journal(self.folder / JOURNAL)
        self.unseen = set(self.options.full)

    def tasks(self, track: Track) -> Iterator[tuple[Entry]]:
        """The objects that are not done, with their numbers kept until their results come."""
        number = 0
        for i, entry in enumerate(self.source.objects()):
            self.unseen.discard(entry.name)
            key = worker.key_of(entry, self.options)
            place = None if self._needs_folder(entry.name) else self.journal.find(key)
            if place is not None:
                self.places[i] = place
                self.reused += 1
                track.more(-1)
                continue
            self._waiting[number] = i, entry.name, key
            number += 1
            yield (entry,)

    def keep(self, number: int, row: dict[str, Any] | BaseException, track: Track) -> None:
        """Append the result of a task to the journal."""
        i, name, key = self._waiting.pop(number)
        if isinstance(row, BaseException):
            row = worker.failed(name, _reason(row)) | {"seconds": None}
        retry = row.pop("retry")
        self.places[i] = self.journal.add(key, row, final=not retry)
        track.advance(1, f"{name} {row['status']}")

    def _needs_folder(self, name: str) -> bool:
        if name not in self.options.full:
            return False
        return not (
            self.folder / "objects" / survey_table.folder_name(name) / "summary.json"
        ).is_file()


def _reason(fault: BaseException) -> str:
    if type(fault).__name__ == "KilledWorker":
        return f"{DEATHS + 1} workers died of it: too little memory, or a fault of a library"
    return ": ".join([type(fault).__name__, *str(fault).strip().splitlines()[:1]])
