"""Scenarios that ship with the package, and the parts that scenario files are read with."""

from importlib import resources
from pathlib import Path


def bundled() -> dict[str, Path]:
    """The scenarios that ship with the package: name → file."""
    folder = Path(str(resources.files(__name__)))
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}
