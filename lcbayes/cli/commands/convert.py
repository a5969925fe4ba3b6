"""`lcbayes convert IN OUT`: any light curve that can be read, as CSV or ECSV with directions."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from pathlib import Path

from lcbayes.cli.commands.reading import add_reading_arguments, read_from
from lcbayes.core.errors import EXIT_DONE, InputError

HELP = "rewrite a light curve as CSV or ECSV, with directions to Sun and observer"
EPILOG = """\
examples:
  lcbayes convert 43_Ariadne.lcs ariadne.csv
  lcbayes convert pass.csv pass.ecsv --tle object.tle
"""
SUFFIXES = (".csv", ".ecsv")


def add_arguments(parser: ArgumentParser) -> None:
    """Add the arguments of the command."""
    add_reading_arguments(parser)
    parser.add_argument("output", metavar="OUT", help="file to write, .csv or .ecsv")


def run(args: Namespace) -> int:
    """Read, write, and say what was read and what was left out."""
    from lcbayes.data.write import write

    if Path(args.output).suffix.lower() not in SUFFIXES:
        raise InputError(f"OUT is {args.output!r}; expected a name ending in .csv or .ecsv")
    curve = read_from(args)
    if Path(args.output).resolve() == Path(args.curve).resolve():
        raise InputError(f"OUT is the input, {args.output}; give another name")
    write(curve, args.output)
    print(f"{args.output}: {curve!r}")
    if "notes" in curve.source:
        print(f"note: {curve.source['notes']}")
    return EXIT_DONE
