"""`lcbayes models [NAME]`: what can be fitted, and with which options."""

from __future__ import annotations

import argparse
import inspect

from lcbayes.core.errors import EXIT_DONE

HELP = "list the models, or the options of one"
EPILOG = """\
examples:
  lcbayes models
  lcbayes models faceted
  lcbayes models ./mine.py        # checks a file of your own
  lcbayes models --contract       # what such a file must define
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("name", nargs="?", metavar="NAME", help="a model, or a file with one")
    parser.add_argument("--contract", action="store_true", help="what a model file must define")


def run(args: argparse.Namespace) -> int:
    from lcbayes.modelling import registry

    if args.contract:
        print(registry.__doc__)
    elif args.name is None:
        for name in registry.BUILT_IN:
            print(f"{name:14s} {registry.find(name).summary}")
    else:
        entry = registry.find(args.name)
        print(f"{entry.name}: {entry.summary}\n")
        print(inspect.getdoc(entry.model) or "")
        print("\noptions:")
        for option in entry.options.values():
            default = "must be given" if option.required else f"default {option.default!r}"
            print(f"  {option.name:16s} {option.type.__name__:6s} {default}")
    return EXIT_DONE
