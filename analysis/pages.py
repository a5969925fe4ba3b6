"""The templates of pages."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lcbayes.core.options import Options, declared_options

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
        if name not in declared:
            words += ["--set", f"{name}={value}"]
        elif isinstance(value, bool):
            words += [declared[name].flag] if value else []
        elif isinstance(value, list) and declared[name].declared.parse is None:
            words += [word for item in value for word in (declared[name].flag, item)]
        elif isinstance(value, list):
            words += [declared[name].flag, ",".join(map(str, value))]
        elif value != declared[name].default:
            words += [declared[name].flag, value]
    for name, value in record.get("reading", {}).items():
        words += ["--" + name.replace("_", "-"), value]
    return shlex.join(map(str, [*words, "-o", "DIR"]))


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
