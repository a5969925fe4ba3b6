"""The templates of pages."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lcbayes.core.options import Option, Options, declared_options

TEMPLATES = Path(__file__).parent / "templates"


def command(record: Mapping[str, Any], options: type[Options]) -> str:
    """The command line that gives the same numbers.

    Parameters
    ----------
    record : content of ``run.toml``
    options : options of its task; all others are options of the model
    """
    words = ["lcbayes", record["task"], record.get("curve", "CURVE")]
    declared = declared_options(options)
    for name, value in record["options"].items():
        words += _option(declared.get(name), name, value)
    for name, value in record.get("reading", {}).items():
        words += ["--" + name.replace("_", "-"), value]
    return shlex.join(map(str, [*words, "-o", "DIR"]))


def _option(declared: Option | None, name: str, value: Any) -> list[Any]:
    """The words of one option on a command line; none if it has its default value."""
    if declared is None:
        return ["--set", f"{name}={value}"]
    if isinstance(value, bool):
        return [declared.flag] if value else []
    if not isinstance(value, list):
        return [declared.flag, value] if value != declared.default else []
    if declared.declared.parse is None:
        return [word for item in value for word in (declared.flag, item)]
    return [declared.flag, ",".join(map(str, value))]


def environment() -> Any:
    """The Jinja environment with the project's templates; an undefined name is an error."""
    import jinja2

    return jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
