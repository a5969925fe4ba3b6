"""A folder, or a pattern, with one file for each object: inputs of Asteroids@home, DAMIT, CSV."""

from __future__ import annotations

import glob
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from lcbayes.core.errors import InputError
from lcbayes.core.files import printable, read_bytes, read_text
from lcbayes.data.catalogues.entry import Entry, once
from lcbayes.data.formats.damit import is_damit, is_period_search

CURVES = {".csv", ".ecsv", ".lcs"}  # in a folder; other files are recognised by their content
PREFIX = "period_search_in_"  # of the inputs of Asteroids@home
HEAD = 8192  # bytes by which a file is recognised


@dataclass(frozen=True)
class Folder:
    """Files below a folder, or those of a pattern; other files of a folder are left out."""

    path: str

    @cached_property
    def left_out(self) -> list[Path]:
        """Files of the folder that are no light curves."""
        known = set(self.files)
        return [p for p in self._every if p not in known]

    @cached_property
    def _every(self) -> list[Path]:
        folder = Path(self.path)
        paths = folder.rglob("*") if folder.is_dir() else map(Path, glob.glob(self.path))
        return [p for p in sorted(paths) if p.is_file() and p.name[0] != "."]

    @cached_property
    def files(self) -> list[Path]:
        """The light curves, in order of their paths.

        Raises
        ------
        InputError
            There is none.
        """
        chosen = not Path(self.path).is_dir()
        files = [p for p in self._every if chosen or _is_curve(p)]
        if not files:
            raise InputError(
                f"{printable(self.path)} holds no light curve; give a folder of DAMIT files or "
                "inputs of Asteroids@home, or a table with the rows of all objects"
            )
        return files

    def count(self) -> int:
        """The number of objects."""
        return once(map(self._name, self.files), printable(self.path))

    def objects(self) -> Iterator[Entry]:
        """Every object with the text of its file."""
        for path in self.files:
            try:
                yield Entry(self._name(path), read_text(path))
            except InputError as fault:
                yield Entry(self._name(path), None, str(fault))

    def _name(self, path: Path) -> str:
        folder = Path(self.path)
        inside = path.relative_to(folder) if folder.is_dir() else Path(path.name)
        known = inside.suffix.lower() in (*CURVES, ".txt", ".dat")
        text = str(inside.with_suffix("") if known else inside)
        return printable(text.replace(PREFIX, ""))


def _is_curve(path: Path) -> bool:
    if path.suffix.lower() in CURVES or path.name.startswith(PREFIX):
        return True
    try:
        with path.open("rb") as file:
            start = file.read(HEAD)
        text = read_bytes(path).decode("latin-1") if start[:2] == b"\x1f\x8b" else None
    except (OSError, InputError):
        return False
    text = start.decode("latin-1") if text is None else text
    text = text.replace("\r\n", "\n")
    return is_damit(text) or is_period_search(text)
