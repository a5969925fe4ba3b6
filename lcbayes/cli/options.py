"""Options of tasks on the command line."""

from __future__ import annotations

import argparse
from argparse import ArgumentParser, Namespace
from typing import Any

from lcbayes.core.options import Option, Options, declared_options


def add_options(parser: ArgumentParser, options: type[Options]) -> None:
    """Add a flag for every option; without the flag, the default of the options applies."""
    for name, declared in declared_options(options).items():
        if declared.declared.positional:
            nargs = None if declared.required else "?"
            parser.add_argument(name, nargs=nargs, **_keywords(declared))
            continue
        names = [declared.flag, *declared.declared.aliases]
        if declared.declared.short:
            names.insert(0, f"-{declared.declared.short}")
        parser.add_argument(*names, dest=name, **_keywords(declared))


def _keywords(declared: Option) -> dict[str, Any]:
    text = declared.description.replace("%", "%%")
    common = {"default": argparse.SUPPRESS, "help": text}
    if declared.kind is bool:
        return common | {"action": "store_true"}
    if declared.repeated and declared.declared.parse is None and declared.length is None:
        several = {"action": "extend", "nargs": "+"}
        common |= several if declared.declared.several else {"action": "append"}
    return common | {"metavar": declared.placeholder}


def options_from(args: Namespace, options: type[Options]) -> dict[str, Any]:
    """The given options, as text."""
    return {name: vars(args)[name] for name in declared_options(options) if name in args}
