"""Folders of results: made, kept to one run at a time, and the record of what made them."""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from lcbayes.core.checkpoint import IDENTITY
from lcbayes.core.errors import InputError
from lcbayes.core.version import installed_version
from lcbayes.data.lightcurve import LightCurve

LOCK, RECORD = ".lock", "run.toml"
ASIDE = ".new-"  # what begins so is not complete
REPORT = ("report.html", "figures", "shape.obj", "shape-[0-9]*.obj")


def make_folder(folder: str | Path) -> Path:
    """The folder, made if need be; an InputError where it cannot be written."""
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as fault:
        raise InputError(
            f"the folder {folder} cannot be made ({fault.strerror}); choose another with -o"
        ) from None
    if not os.access(folder, os.W_OK):
        raise InputError(f"the folder {folder} cannot be written; choose another with -o")
    return folder


def put_in_place(scratch: Path, folder: Path) -> None:
    """Everything made in ``scratch`` into the folder, in place of what is there by that name."""
    if (folder / "figures").exists() and (scratch / "figures").exists():
        shutil.rmtree(folder / "figures")
    for made in scratch.iterdir():
        os.replace(made, folder / made.name)


@contextlib.contextmanager
def made_aside(folder: Path, drawn: Iterable[str]) -> Iterator[Path]:
    """Where to make a result that goes into the folder when it is complete; ``drawn`` are patterns
    of what is drawn from a result, of which that of an earlier one goes before."""
    scratch = Path(tempfile.mkdtemp(prefix=ASIDE, dir=folder))
    try:
        yield scratch
        if (folder / RECORD).exists():  # else they are not of a result, but the user's own
            for old in [path for pattern in drawn for path in folder.glob(pattern)]:
                _remove(old)
        put_in_place(scratch, folder)
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink()


@contextlib.contextmanager
def alone_in(out: str | Path | None, written: Iterable[str]) -> Iterator[Path | None]:
    """The results folder, kept from a second run for as long as this one lasts; ``written`` are
    the files that a run puts there."""
    if out is None:
        yield None
        return
    fresh = not Path(out).exists()
    folder = make_folder(out)
    import fcntl

    with open(folder / LOCK, "w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise InputError(
                f"another run is writing into {folder}; wait for it or choose another with -o"
            ) from None
        for name in written:
            for scratch in folder.glob(f".{name}-*"):  # of a run that was killed while writing
                scratch.unlink(missing_ok=True)
        for scratch in folder.glob(f"{ASIDE}*"):
            _remove(scratch)
        try:
            yield folder
        except InputError:
            if fresh and not _worked_in(folder):  # a refused run leaves nothing behind
                shutil.rmtree(folder, ignore_errors=True)
            raise


def _worked_in(folder: Path) -> bool:
    """Whether a run has left more there than it begins with."""
    return any(p.is_file() and p.name not in (LOCK, IDENTITY) for p in folder.rglob("*"))


def record(
    curve: LightCurve,
    model: str,
    settings: Mapping[str, Any],
    options: Mapping[str, Any],
    reading: Mapping[str, Any] | None,
) -> dict[str, Any]:
    """The content of ``run.toml``: everything needed to run it again."""
    return {
        "curve": os.path.abspath(curve.source["file"]) if curve.source.get("file") else "",
        "model": str(Path(model).resolve()) if model.endswith(".py") else model,
        **settings,
        "options": options,
        "reading": dict(reading or {}),
        "input": {k: curve.source[k] for k in ("format", "sha256") if k in curve.source},
        "version": installed_version(),
    }
