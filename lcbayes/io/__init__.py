"""Light curves in and out of files."""

from lcbayes.io._read import FORMATS, read, read_geometry
from lcbayes.io._write import write

__all__ = ["FORMATS", "read", "read_geometry", "write"]
