"""Bodies of known shape for fits: the bundled ones, and the reader of their files."""

from importlib import resources
from pathlib import Path


def bundled() -> dict[str, Path]:
    """The bundled bodies: name → file."""
    folder = Path(str(resources.files(__name__)))
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}
