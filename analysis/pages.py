"""Where pages get their templates from."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lcbayes.core.options import Options, declared_options

TEMPLATES = Path(__file__).parent / "templates"


def command(record: Mapping[str, Any], options: type[Options]) -> str:
    """What to type for the same numbers.

    Parameters
    ----------
    record : content of ``run.toml``
    options : of its task; every other option is one of the model's
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
    """Jinja with the project's templates; a name that is not given is an error."""
    import jinja2

    return jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
