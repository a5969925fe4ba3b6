"""Checkpoints on disk, from which an interrupted run resumes."""

from __future__ import annotations

import json
import shutil
import zlib
from collections.abc import Callable
from copy import copy
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from lcbayes.core.files import write_atomic

Arrays = dict[str, np.ndarray]
IDENTITY = "identity.json"


class Checkpoint:
    """Named sets of arrays in a folder that belongs to one exact run.

    ``identity`` contains everything that determines the results: data, model, options, seed,
    versions. A folder left by a run with a different identity, or by a completed run, is emptied
    first. Without a folder nothing is stored. Messages for the user are passed to ``say``.
    """

    def __init__(
        self,
        folder: Path | None,
        identity: dict[str, Any],
        say: Callable[[str], None] = lambda _: None,
    ) -> None:
        self.folder, self._say, self._prefix = folder, say, ""
        if folder is None:
            return
        stamp = folder / IDENTITY
        text = json.dumps(identity, sort_keys=True, indent=1).encode()
        if not (stamp.is_file() and stamp.read_bytes() == text):
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir(parents=True)
            write_atomic(stamp, lambda p: p.write_bytes(text))
        if self.resumed:
            say(f"resuming the run that stopped in {folder.parent}")

    def within(self, part: str) -> Checkpoint:
        """The arrays of a part of the run: their names begin with that of the part."""
        inner = copy(self)
        inner._prefix = f"{self._prefix}{part}-"
        return inner

    @property
    def resumed(self) -> bool:
        """Whether an earlier run left arrays to resume from."""
        return self.folder is not None and any(self.folder.glob("*.npz"))

    def load(self, name: str) -> Arrays | None:
        """The arrays saved under that name, or None if they are missing or unreadable."""
        if self.folder is None or not (path := self._path(self.folder, name)).is_file():
            return None
        try:
            with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
                return dict(stored)
        except (OSError, EOFError, ValueError, RuntimeError, BadZipFile, zlib.error):
            self._say(f"{path} is damaged; that part is done again")
            return None

    def save(self, name: str, arrays: Arrays) -> None:
        if self.folder is not None:
            write_atomic(
                self._path(self.folder, name), lambda p: np.savez(p, allow_pickle=False, **arrays)
            )

    def once[T](self, name: str, kind: Callable[..., T], compute: Callable[[], T]) -> T:
        """A named tuple of arrays as saved under that name, or computed and saved."""
        stored = self.load(name)
        if stored is not None:
            return kind(**stored)
        value = compute()
        self.save(name, value._asdict())  # pyright: ignore[reportAttributeAccessIssue]
        return value

    def _path(self, folder: Path, name: str) -> Path:
        return folder / f"{self._prefix}{name}.npz"

    def finish(self) -> None:
        """Discard the checkpoint after the results are written; the next run starts afresh."""
        if self.folder is not None:
            shutil.rmtree(self.folder, ignore_errors=True)
            self.folder.mkdir(parents=True, exist_ok=True)
