"""The scripts of `analysis/papers`, for the tests of what they compute and write."""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

FOLDER = Path(__file__).resolve().parents[2] / "analysis" / "papers"


def load(name: str) -> Any:
    """A script as a module. The scripts import one another, so their folder leads the search path
    while it is loaded."""
    sys.path.insert(0, str(FOLDER))
    try:
        result: ModuleType = import_module(name)
    finally:
        sys.path.remove(str(FOLDER))
    return result
