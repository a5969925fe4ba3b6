"""Results folders: locking, staging and publication.

A folder holds the result of one task. A task writes into a staging folder within it. When the
result is complete, the files are moved into place one by one, so a run that is killed leaves the
earlier result unchanged. ``run.toml`` records the task, its options, the version, and every input
file with its hash.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import shutil
import tempfile
import tomllib
from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lcbayes.core.checkpoint import IDENTITY, Checkpoint
from lcbayes.core.errors import InputError
from lcbayes.core.files import write_atomic
from lcbayes.core.toml import to_toml

SCHEMA = 4
RECORD, SUMMARY, LOCK, CHECKPOINT = "run.toml", "summary.json", ".lock", "checkpoint"
STAGING = ".new-"  # prefix of staging folders
# Files that tasks write. All those of an earlier result of the same task are removed.
PAGE = ("report.html", "figures", "shape.*", "shape-[0-9]*.*", "spin.txt", "spin-[0-9]*.txt")
WRITTEN = (
    *PAGE,
    "posterior.nc",
    "scan.nc",
    SUMMARY,
    RECORD,
    "tables",
    "facets-[0-9]*",
    "observability.json",
)


@dataclass(frozen=True)
class ResultsFolder:
    """A results folder that is locked for one run.

    Attributes
    ----------
    path : the folder
    task : name of the task whose results it holds
    """

    path: Path
    task: str

    def checkpoint(self, identity: dict[str, Any], say: Callable[[str], None]) -> Checkpoint:
        """The checkpoint from which a run of this identity can resume."""
        return Checkpoint(self.path / CHECKPOINT, identity, say)

    @contextlib.contextmanager
    def staging(self, replaces: tuple[str, ...] = WRITTEN) -> Generator[Path]:
        """A folder to write a result into. At the end of the block its files replace those of the
        earlier result that match ``replaces``."""
        scratch = Path(tempfile.mkdtemp(prefix=STAGING, dir=self.path))
        try:
            yield scratch
            self._publish(scratch, replaces)
        finally:
            shutil.rmtree(scratch, ignore_errors=True)

    def _publish(self, scratch: Path, replaces: tuple[str, ...]) -> None:
        made = {path.name for path in scratch.iterdir()}
        if (self.path / RECORD).exists():  # otherwise files of these names belong to the user
            for old in [path for pattern in replaces for path in self.path.glob(pattern)]:
                if old.name not in made or old.is_dir():
                    _remove(old)
        for name in sorted(made, key=lambda name: name == RECORD):  # the record last
            os.replace(scratch / name, self.path / name)


@contextlib.contextmanager
def results_folder(out: str | Path, task: str) -> Generator[ResultsFolder]:
    """The folder, created if necessary, locked, and cleared of the remains of a killed run.

    Raises
    ------
    InputError
        It cannot be written, another run is writing to it, or it holds results of another task.
    """
    fresh = not Path(out).exists()
    path = _made(out)
    check_task(path, task)
    with open(path / LOCK, "a+", encoding="utf-8") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise InputError(
                f"another run is writing into {path}; wait for it or choose another folder with -o"
            ) from None
        lock.truncate(0)
        lock.write(task)  # the task of the checkpoint, until there is a record
        lock.flush()
        for unfinished in path.glob(f"{STAGING}*"):
            _remove(unfinished)
        try:
            yield ResultsFolder(path, task)
        except InputError:
            if fresh and not _has_work(path):  # a refused run leaves nothing behind
                shutil.rmtree(path, ignore_errors=True)
            raise


def task_of(folder: Path) -> str | None:
    """The task whose results a folder holds; None if it holds no results."""
    try:
        content = tomllib.loads((folder / RECORD).read_text(encoding="utf-8"))
    except OSError:
        return None
    except ValueError:
        content = {}
    task = content.get("task", "of another version")
    return task if isinstance(task, str) else None


def check_task(folder: Path, task: str) -> None:
    """Raise an InputError if a folder holds the results of another task."""
    held = task_of(folder) or _interrupted(folder)
    if held is not None and held != task:
        raise InputError(
            f"the folder {folder} already holds results of lcbayes {held}; choose another with -o"
        )


def _interrupted(folder: Path) -> str | None:
    """The task of an interrupted run that can resume."""
    if not any((folder / CHECKPOINT).glob("*.npz")):
        return None
    return (folder / LOCK).read_text(encoding="utf-8") or None if (folder / LOCK).exists() else None


def _made(out: str | Path) -> Path:
    path = Path(out)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as fault:
        raise InputError(
            f"the folder {path} cannot be made ({fault.strerror}); choose another with -o"
        ) from None
    if not os.access(path, os.W_OK):
        raise InputError(f"the folder {path} cannot be written; choose another with -o")
    return path


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink()


def _has_work(path: Path) -> bool:
    """Whether a run has left more in a folder than it creates at its start."""
    return any(p.is_file() and p.name not in (LOCK, IDENTITY) for p in path.rglob("*"))


def write_record(folder: Path, record: Mapping[str, Any]) -> None:
    """Write ``run.toml``."""
    text = to_toml({"schema": SCHEMA, **record})
    write_atomic(folder / RECORD, lambda p: p.write_text(text, encoding="utf-8"))
