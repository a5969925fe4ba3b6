"""The files of a results folder read again; every fault in them is an InputError."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from lcbayes.core.errors import InputError

if TYPE_CHECKING:
    import xarray as xr

READING = ("format", "tle", "site", "error", "error_floor")  # options a light curve is read with


class Config(NamedTuple):
    """What a run.toml says: keywords of `lcbayes.fit`, options of the model, the light curve and
    how it was read."""

    keywords: dict[str, Any]
    options: dict[str, Any]
    curve: str | None
    digest: str
    reading: dict[str, Any]


def read_config(path: Path) -> Config:
    """A ``run.toml``.

    Raises
    ------
    InputError
        It is none; or a part of it is not of the kind that `lcbayes fit` writes.
    """
    from lcbayes.core.toml import read_toml
    from lcbayes.samplers.settings import Settings

    root = read_toml(path)
    content = root.values
    names = {f.name for f in dataclasses.fields(Settings) if f.init} - {"sampler"}
    keywords = {k: content[k] for k in names if k in content}
    keywords |= {
        k: root.text(k) for k in ("model", "sampler", "start_from") if content.get(k) is not None
    }
    empty = root.blank()
    wanted = root.table("reading", empty)
    for name in wanted.keys():  # noqa: SIM118 - a Table is no mapping
        if name not in READING:
            raise wanted.fault(name, f"is not known; expected of: {', '.join(READING)}")
    numbers = ("error", "error_floor")
    reading = {
        k: wanted.number(k) if k in numbers else wanted.text(k) for k in READING if k in wanted
    }
    digest = root.table("input", empty).text("sha256", "")
    options = root.table("options", empty).values
    return Config(keywords, options, root.text("curve", None), digest, reading)


def read_json(path: Path, kinds: Mapping[str, type]) -> dict[str, Any]:
    """A JSON object whose values, where they are there, are of those kinds.

    Raises
    ------
    InputError
    """
    again = "run the command that wrote it again"
    try:
        found = json.loads(path.read_bytes())
    except FileNotFoundError:
        raise InputError(f"{path} is missing; {again}") from None
    except json.JSONDecodeError as fault:
        raise InputError(f"{path}, line {fault.lineno}: {fault.msg}; {again}") from None
    except (OSError, ValueError, RecursionError) as fault:
        raise InputError(f"{path} cannot be read ({_told(fault)}); {again}") from None
    if not isinstance(found, dict):
        raise InputError(f"{path} is no JSON object; {again}")
    for key, kind in kinds.items():
        if not isinstance(found.get(key), kind | None):
            said = {dict: "an object", list: "a list", str: "a string"}[kind]
            raise InputError(f"{path}: {key} is not {said}; {again}")
    return found


@contextmanager
def open_posterior(folder: Path) -> Iterator[xr.DataTree]:
    """The ``posterior.nc`` of a fit. What is read of it may fail here or later, as it is lazy.

    Raises
    ------
    InputError
        There is none, or it is damaged.
    """
    import xarray as xr

    path = folder / "posterior.nc"
    if not path.is_file():
        raise InputError(
            f"{folder} holds no posterior.nc; give the folder that `lcbayes fit -o` wrote"
        )
    try:
        with xr.open_datatree(path, engine="h5netcdf") as tree:
            yield tree
    except InputError:
        raise
    except (OSError, ValueError, KeyError, RuntimeError) as fault:
        raise InputError(
            f"{path} cannot be read ({_told(fault)}); run `lcbayes fit` again"
        ) from fault


def _told(fault: Exception) -> str:
    return (str(fault).splitlines() or [type(fault).__name__])[0]
