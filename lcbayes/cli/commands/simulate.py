"""`lcbayes simulate`: a light curve from a scenario, and the truth beside it."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from lcbayes.cli.commands.reading import check_seed
from lcbayes.core.errors import EXIT_DONE, InputError

HELP = "make a light curve from a scenario file, or from a bundled scenario"
EPILOG = """\
examples:
  lcbayes simulate --list
  lcbayes simulate box-wing -o box-wing.csv --seed 1
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    parser.add_argument(
        "scenario", nargs="?", metavar="SCENARIO", help="a TOML file, or a name from --list"
    )
    parser.add_argument("-o", "--output", metavar="FILE", help="light curve to write (CSV or ECSV)")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of the noise (default 0)")
    parser.add_argument("--list", action="store_true", help="name the bundled scenarios and stop")


def run(args: argparse.Namespace) -> int:
    """Write the light curve and, beside it, the truth."""
    if args.list:
        return _list()
    if args.scenario is None:
        raise InputError("no scenario given; give a TOML file or a name that --list shows")
    if args.output is None:
        raise InputError("no output given; say where the light curve goes with -o FILE")
    check_seed(args)

    from lcbayes.core.files import write_text
    from lcbayes.data.write import write
    from lcbayes.simulation.scenarios.scenario import load
    from lcbayes.simulation.simulate import sidecar, simulate

    output = Path(args.output)
    scenario = load(args.scenario)
    curve, truth = simulate(scenario, args.seed)
    write(curve, output)
    write_text(json.dumps(truth, indent=1) + "\n", sidecar(output))
    dark = truth["n_dark_left_out"]
    left_out = f" ({dark} epochs at which the body is dark left out)" if dark else ""
    print(f"{output}: {curve.n_obs} points of {scenario.name}{left_out}; truth: {sidecar(output)}")
    return EXIT_DONE


def _list() -> int:
    import tomllib

    from lcbayes.simulation.scenarios import bundled

    for name, path in bundled().items():
        title = tomllib.loads(path.read_text(encoding="utf-8")).get("title", "")
        sys.stdout.write(f"{name:18s} {title}\n")
    return EXIT_DONE
