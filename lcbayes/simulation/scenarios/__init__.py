"""Bundled scenarios, and the readers of scenario files."""

from importlib import resources
from pathlib import Path


def bundled() -> dict[str, Path]:
    """The bundled scenarios: name → file."""
    folder = Path(str(resources.files(__name__)))
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}
