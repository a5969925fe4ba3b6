"""`lcbayes models`."""

from __future__ import annotations

import inspect

from lcbayes.core.errors import EXIT_DONE
from lcbayes.core.toml import read_toml
from lcbayes.modelling import registry
from lcbayes.simulation.known_bodies import bundled
from lcbayes.tasks.models.options import ModelsOptions


def command(_source: None, options: ModelsOptions) -> int:
    """Print the models, the options of one model, or the requirements of a model file."""
    if options.contract:
        print(registry.__doc__)
    elif options.name is None:
        for name in registry.BUILT_IN:
            print(f"{name:14s} {registry.find(name).summary}")
    else:
        entry = registry.find(options.name)
        print(f"{entry.name}: {entry.summary}\n")
        print(inspect.getdoc(entry.model) or "")
        print("\noptions:")
        for declared in entry.options.values():
            default = "must be given" if declared.required else f"default {declared.default!r}"
            print(f"  {declared.name:16s} {declared.type.__name__:6s} {default}")
        if entry.name == "body":
            print("\nbundled bodies:")
            for name, path in bundled().items():
                print(f"  {name:16s} {read_toml(path).text('title')}")
    return EXIT_DONE
