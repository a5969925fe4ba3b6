"""Reading of text files in any supported encoding, and atomic writing."""

from __future__ import annotations

import hashlib
import json
import os
import secrets
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lcbayes.core.errors import InputError

MAX_BYTES = 512 << 20
_GZIP = b"\x1f\x8b"
PIECE = 1 << 20  # bytes that are inspected before more are read


@dataclass(frozen=True)
class TextFile:
    """A file's text, with \\n as line ends, and its origin."""

    path: Path
    text: str
    sha256: str
    notes: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """The path as the user gave it, as text."""
        return printable(self.path)

    def at(self, line: int) -> str:
        """A place in this file, for messages."""
        return f"{self.name}, line {line}"


def printable(path: str | os.PathLike[str]) -> str:
    """A path as valid UTF-8 text; other bytes are escaped, e.g. as ``\\xe9``."""
    return str(path).encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")


def read_bytes(path: str | os.PathLike[str], most: int = MAX_BYTES) -> bytes:
    """The bytes of a text file; reading stops if it proves too large or binary.

    Raises
    ------
    InputError
        The file is missing, a folder, unreadable, binary, or larger than ``most`` bytes.
    """
    name = printable(path)
    try:
        with Path(path).open("rb") as file:
            size, pieces = os.fstat(file.fileno()).st_size, [b""]
            while size <= most and not _binary(pieces) and (piece := file.read(PIECE)):
                pieces.append(piece)
                size = max(size, sum(map(len, pieces)))  # the size of a pipe or device is 0
    except FileNotFoundError:
        raise InputError(f"{name} does not exist; check the path") from None
    except IsADirectoryError:
        raise InputError(f"{name} is a folder; give a file") from None
    except OSError as fault:
        raise InputError(f"{name} cannot be read ({fault.strerror}); check its rights") from None
    except ValueError as fault:
        raise InputError(f"{name!r} can name no file ({fault}); correct the path") from None
    if size > most:
        raise InputError(
            f"{name} has over {most >> 20} MiB, the most that is read; keep what is needed of it"
        )
    data = b"".join(pieces)
    return _unpacked(name, data, most) if data.startswith(_GZIP) else data


def _unpacked(name: str, data: bytes, most: int) -> bytes:
    """The decompressed content of a gzip file, up to a maximum size."""
    unpacker = zlib.decompressobj(wbits=31)
    try:
        text = unpacker.decompress(data, most + 1)
    except zlib.error as fault:
        raise InputError(f"{name} is a damaged gzip file ({fault}); get it again") from None
    if len(text) > most:
        raise InputError(f"{name} unpacks to over {most >> 20} MiB, the most that is read")
    if not unpacker.eof:
        raise InputError(f"{name} is a gzip file that was cut short; get it again")
    return text


def _binary(pieces: list[bytes]) -> bool:
    """Whether the piece read last is neither text nor compressed text."""
    packed = len(pieces) > 1 and pieces[1].startswith(_GZIP)
    return bool(_control(pieces[-1])) and not packed


def _control(data: bytes) -> bytes:
    """The bytes that do not occur in text."""
    return data.translate(None, delete=_TEXT_BYTES)


def read_text(path: str | os.PathLike[str]) -> TextFile:
    """Read a text file as UTF-8, or as Latin-1 if its bytes are not valid UTF-8.

    Raises
    ------
    InputError
        The file is missing, a folder, unreadable, empty, or not text.
    """
    data = read_bytes(path)
    text, notes = _decode(printable(path), data)
    if not text.strip():
        raise InputError(f"{printable(path)} is empty; check that it was saved, or give another")
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    return TextFile(Path(path), text, hashlib.sha256(data).hexdigest(), notes)


def _decode(path: str, data: bytes) -> tuple[str, tuple[str, ...]]:
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise InputError(f"{path} is UTF-16 text; save it as UTF-8")
    for start, kind, remedy in _OTHER_KINDS:
        if data.startswith(start):
            raise InputError(f"{path} is {kind}; {remedy}")
    if control := _control(data):
        where = data.index(control[:1])
        line = data.count(b"\n", 0, where) + 1
        raise InputError(
            f"{path}, line {line}: byte {control[0]:#04x} at offset {where} is not text, so this "
            "is a binary file; export it as CSV"
        )
    try:
        return data.decode("utf-8-sig"), ()
    except UnicodeDecodeError as fault:
        line = data.count(b"\n", 0, fault.start) + 1
        if any(0x80 <= byte < 0xA0 for byte in set(data)):
            raise InputError(
                f"{path}, line {line}: byte {data[fault.start]:#04x} is neither UTF-8 nor "
                "Latin-1; save the file as UTF-8"
            ) from None
        return data.decode("latin-1"), (f"read as Latin-1 (line {line} is not UTF-8)",)


_AS_CSV = "save it as CSV"
# first bytes, kind of file, and remedy
_OTHER_KINDS = (
    (b"PK\x03\x04", "an Excel workbook or another zip archive", _AS_CSV),
    (b"\xd0\xcf\x11\xe0", "an old Excel or Word document", _AS_CSV),
    (b"SIMPLE  =", "a FITS file", "write its table as ECSV with astropy, or as CSV"),
    (b"\x93NUMPY", "a NumPy array", "write it as CSV with the names of the columns"),
    (b"\x89HDF\r\n", "an HDF5 or netCDF file", _AS_CSV),
    (b"%PDF", "a PDF document", "give the table it shows as CSV"),
    (b"<!DOCTYPE", "a web page", "download the file itself"),
    (b"<!doctype", "a web page", "download the file itself"),
    (b"<html", "a web page", "download the file itself"),
)
_TEXT_BYTES = bytes({*range(0x20, 0x7F), *range(0x80, 0x100), *b"\t\n\r\f"})


def write_atomic(path: Path, write: Callable[[Path], object]) -> None:
    """Let ``write`` create a temporary file beside ``path``, then rename it to ``path``.

    If ``path`` is a link, its target is replaced. A device or a pipe is written to directly.
    """
    if path.exists() and not path.is_file():
        write(path)
        return
    target = Path(os.path.realpath(path))
    scratch = target.with_name(f".{target.name}-{secrets.token_hex(4)}{path.suffix}")
    try:
        write(scratch)
        with scratch.open("rb") as made:  # otherwise a power cut may leave an empty file
            os.fsync(made.fileno())
        os.replace(scratch, target)
    finally:
        scratch.unlink(missing_ok=True)


def write_text(text: str, path: str | os.PathLike[str]) -> None:
    """Write a text file atomically, with \\n as line ends.

    Raises
    ------
    InputError
        The folder is missing or cannot be written to.
    """
    path = Path(path)
    if path.is_dir():
        raise InputError(f"{path} is a folder; give the name of a file to write")
    try:
        write_atomic(path, lambda p: p.write_text(text, encoding="utf-8", newline="\n"))
    except OSError as fault:
        raise InputError(
            f"{path} cannot be written ({fault.strerror}); give a path in a folder that exists "
            "and may be written to"
        ) from None


def json_text(content: Mapping[str, Any]) -> str:
    """JSON with a line end; numbers that are not finite become null."""

    def plain(value: Any) -> Any:
        if isinstance(value, Mapping):
            return {str(k): plain(v) for k, v in value.items()}
        if isinstance(value, list | tuple | np.ndarray):
            return [plain(v) for v in value]
        if isinstance(value, np.generic):
            value = value.item()
        if isinstance(value, float) and not np.isfinite(value):
            return None
        return value

    return json.dumps(plain(content), indent=1) + "\n"


def write_json(content: Mapping[str, Any], path: Path) -> None:
    """Write JSON; numbers that are not finite become null."""
    text = json_text(content)
    write_atomic(path, lambda p: p.write_text(text, encoding="utf-8"))
