"""`lcbayes compare CURVE --facets 1-8 -o DIR`: how many facets the data ask for."""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path

from lcbayes.cli.commands.model_options import add_model_arguments, add_settings, model_options
from lcbayes.cli.commands.reading import add_reading_arguments, how_read, read_from
from lcbayes.core.errors import EXIT_DONE, EXIT_NOT_TRUSTED, InputError

HELP = "how many facets: evidence, left-out epochs and probability of each number"
EPILOG = """\
examples:
  lcbayes compare pass.csv --facets 1-8 -o out
  lcbayes compare pass.csv --facets 2,3,4 --num-particles 2000 --num-runs 8 -o out
  lcbayes compare pass.csv --facets 1-4 --sparse 10 -o out
  lcbayes compare starlink.csv --facets 1-3 --model stabilised -o out
  lcbayes compare glint.csv --facets 1-4 --model faceted-brdf --law cook-torrance -o out

Evidences and predictive densities are natural logarithms (nat). Each number of
facets is as likely as the others before the data. The run ends with exit status 3
if its runs differ by more than bears a conclusion, or the particles missed the posterior.
A run that was stopped goes on when the same command is given again.
"""
FLAGS = ("law", "reflectance", "noise_law", "spin")
SETTINGS = {
    "seed": "of every random number (default 0)",
    "num_particles": "particles that move, in each run (default 100)",
    "num_runs": "independent runs for each number of facets (default 4)",
    "num_starts": "starts of the search for the best fit (default 64)",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_reading_arguments(parser)
    parser.add_argument("-o", "--out", metavar="DIR", type=Path, help="folder for the results")
    parser.add_argument(
        "--facets",
        dest="counts",  # `facets` is an option of the model stabilised: --set facets=LIST
        metavar="N-M",
        default="1-8",
        help="numbers to compare: 1-8 (default) or 1,2,4",
    )
    parser.add_argument(
        "--model", metavar="NAME", help="faceted (default), faceted-brdf, stabilised, a file"
    )
    add_model_arguments(parser, FLAGS)
    parser.add_argument(
        "--sparse",
        type=int,
        metavar="N",
        help="also take the sparse path from N facets, and compare where it ends",
    )
    add_settings(parser, SETTINGS)
    parser.add_argument("--no-report", action="store_true", help="write the numbers alone")
    parser.add_argument("--json", action="store_true", help="print compare.json on standard output")


def run(args: argparse.Namespace) -> int:
    if args.out is None:
        raise InputError("where shall the results go? give a folder with -o DIR")
    keywords = {
        name: getattr(args, name)
        for name in ("model", "sparse", *SETTINGS)
        if getattr(args, name) is not None
    }
    counts = numbers(args.counts)
    keywords |= model_options(args)
    if "n_facets" in keywords:
        raise InputError("--set n_facets does not go with compare; name the numbers with --facets")
    curve = read_from(args)

    from lcbayes.core.progress import Console, Silent
    from lcbayes.results.verdict import told
    from lcbayes.tasks.compare.run import compare

    progress = Silent() if args.json else Console()
    found = compare(
        curve,
        counts,
        out=args.out,
        report=not args.no_report,
        progress=progress,
        reading=how_read(args),
        **keywords,
    )
    if args.json:
        sys.stdout.write((args.out / "compare.json").read_text(encoding="utf-8"))
    else:
        if not found.converged:
            print(told(found.reasons))
        print(found.table())
        print(f"\nresults: {args.out if args.no_report else args.out / 'compare.html'}")
    return EXIT_DONE if found.converged else EXIT_NOT_TRUSTED


def numbers(text: str) -> list[int]:
    """The numbers of "1-8", "1,2,4" or "1-3,6"."""
    found = []
    for part in text.split(","):
        ends = re.fullmatch(r"\s*(\d{1,4})(?:-(\d{1,4}))?\s*", part)
        if ends is None or int(ends[2] or ends[1]) < int(ends[1]):
            raise InputError(
                f"--facets {text}: {part!r} is no number or range; expected 1-8 or 1,2,4"
            )
        found += range(int(ends[1]), int(ends[2] or ends[1]) + 1)
    return found
