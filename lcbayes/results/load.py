"""Read the files of a results folder; any fault in them raises an InputError."""

# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownArgumentType=false, reportUnknownVariableType=false
# (pandas, xarray, ArviZ and JAX come without complete types)

from __future__ import annotations

import json
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from lcbayes.core.errors import InputError
from lcbayes.results.store import SCHEMA, SUMMARY

if TYPE_CHECKING:
    import xarray as xr

KINDS = {"reasons": list, "modes": list, "parameters": dict, "fit": dict, "timing": dict}


def read_summary(folder: Path) -> dict[str, Any]:
    """The ``summary.json`` of a results folder.

    Raises
    ------
    InputError
        It is missing or damaged, or another version wrote it.
    """
    path = folder / SUMMARY
    content = read_json(path, KINDS)
    reasons = content.get("reasons")
    valid = (
        content.get("schema") == SCHEMA
        and isinstance(content.get("trusted"), bool)
        and isinstance(reasons, list)
        and all(map(_is_reason, cast("list[Any]", reasons)))
        and content["trusted"] == (not reasons)
    )
    if not valid:
        raise InputError(
            f"{path} is not of this version of lcbayes (schema {SCHEMA}) or is damaged; run the "
            "command that wrote it again"
        )
    return content


def _is_reason(entry: Any) -> bool:
    return isinstance(entry, dict) and {"code", "text"} <= entry.keys()


def read_json(path: Path, kinds: Mapping[str, type]) -> dict[str, Any]:
    """A JSON object whose values, where present, have the given types.

    Raises
    ------
    InputError
    """
    again = "run the command that wrote it again"
    try:
        content = json.loads(path.read_bytes())
    except FileNotFoundError:
        raise InputError(f"{path} is missing; {again}") from None
    except json.JSONDecodeError as fault:
        raise InputError(f"{path}, line {fault.lineno}: {fault.msg}; {again}") from None
    except (OSError, ValueError, RecursionError) as fault:
        raise InputError(f"{path} cannot be read ({_first_line(fault)}); {again}") from None
    if not isinstance(content, dict):
        raise InputError(f"{path} is no JSON object; {again}")
    content = cast("dict[str, Any]", content)
    for key, kind in kinds.items():
        if not isinstance(content.get(key), kind | None):
            said = {dict: "an object", list: "a list", str: "a string"}[kind]
            raise InputError(f"{path}: {key} is not {said}; {again}")
    return content


@contextmanager
def open_posterior(folder: Path) -> Generator[xr.DataTree]:
    """The ``posterior.nc`` of a fit. It is read lazily, so a fault may appear here or later.

    Raises
    ------
    InputError
        It is missing or damaged.
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
            f"{path} cannot be read ({_first_line(fault)}); run `lcbayes fit` again"
        ) from fault


def _first_line(fault: Exception) -> str:
    return (str(fault).splitlines() or [type(fault).__name__])[0]
