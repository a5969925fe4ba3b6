"""Paths that are given in Python."""

from __future__ import annotations

import os
from pathlib import Path

from lcbayes.core.errors import InputError


def as_path(given: object, what: str) -> Path:
    """A path given in Python.

    Raises
    ------
    InputError
        It is of another type.
    """
    if not isinstance(given, str | os.PathLike):
        raise InputError(f"{what} is of type {type(given).__name__}; give a path")
    return Path(given)
