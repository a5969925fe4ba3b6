"""The journal of a survey: one line for each finished object, in a file that only grows.

A line is written as a whole before the next begins, so that a process that is killed leaves at most
one incomplete line, which is removed. Each line begins with the key of its object.
"""

from __future__ import annotations

import json
import os
import time
from array import array
from pathlib import Path
from typing import Any, Self

import numpy as np

from lcbayes.core.errors import InputError

KEY = 16  # hexadecimal digits
SYNC_S = 1.0  # between writes to the disk itself, which a power cut may lose
_START = b'{"key":"'
_FINAL = len(_START) + KEY + len(b'","final":')


class Journal:
    """Objects by key.

    Parameters
    ----------
    path : file, made if necessary
    scan : whether keys are read, so that objects can be found

    Raises
    ------
    InputError
        The file is no journal.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp()) / "objects.jsonl"
    >>> with Journal(path) as journal:
    ...     place = journal.add("00000000000000a1", {"name": "Ceres"})
    >>> with Journal(path) as journal:
    ...     journal.read(journal.find("00000000000000a1"))["name"]
    'Ceres'
    """

    def __init__(self, path: Path, *, scan: bool = True) -> None:
        self.path = path
        self._file = path.open("a+b")
        if scan:
            try:
                self._keys, self._places = self._scanned()
            except InputError:
                self._file.close()
                raise
        self._synced = time.monotonic()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _scanned(self) -> tuple[np.ndarray, np.ndarray]:
        """Keys of the finished objects, in order, and the places of their lines."""
        keys, places, at = array("Q"), array("q"), 0
        self._file.seek(0)
        for line in self._file:
            if not line.endswith(b"\n"):
                break
            if not line.startswith(_START):
                raise InputError(f"{self.path} is no journal of a survey; choose another with -o")
            if line[_FINAL : _FINAL + 1] == b"1":
                keys.append(int(line[len(_START) : len(_START) + KEY], 16))
                places.append(at)
            at += len(line)
        self._file.truncate(at)
        key = np.array(keys, np.uint64)
        order = np.argsort(key, kind="stable")
        return key[order], np.array(places, np.int64)[order]

    def find(self, key: str) -> int | None:
        """The place of an object that an earlier run finished, or None."""
        number = np.uint64(int(key, 16))
        at = int(np.searchsorted(self._keys, number, side="right")) - 1
        return int(self._places[at]) if at >= 0 and self._keys[at] == number else None

    def add(self, key: str, content: dict[str, Any], *, final: bool = True) -> int:
        """Append an object, and return its place. One that is not final is done again later."""
        head = f'{{"key":"{key}","final":{int(final)},'
        line = head.encode() + json.dumps(content, separators=(",", ":")).encode()[1:] + b"\n"
        place = self._file.seek(0, os.SEEK_END)
        self._file.write(line)
        self._file.flush()
        if time.monotonic() - self._synced > SYNC_S:
            os.fsync(self._file.fileno())
            self._synced = time.monotonic()
        return place

    def read(self, place: int) -> dict[str, Any]:
        """The object at a place."""
        self._file.seek(place)
        return json.loads(self._file.readline())

    def close(self) -> None:
        """Write everything to the disk, and close the file."""
        self._file.flush()
        os.fsync(self._file.fileno())
        self._file.close()
