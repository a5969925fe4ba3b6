"""`lcbayes batch CATALOGUE -o DIR`: many objects."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from lcbayes.cli.commands.fit import SETTINGS
from lcbayes.cli.commands.model_options import (
    FLAGS,
    add_model_arguments,
    add_settings,
    model_options,
)
from lcbayes.cli.commands.reading import add_reading_options
from lcbayes.core.errors import EXIT_DONE, EXIT_NOT_TRUSTED, InputError
from lcbayes.results.load import READING

HELP = "fit of every object of a catalogue, resumable, on this machine or on a Dask cluster"
EPILOG = """\
examples:
  lcbayes batch night.csv -o night --n-facets 2 --seed 1
  lcbayes batch curves/ -o night --tle objects.tle --reports
  lcbayes batch 'curves/*.ecsv' -o night --scheduler tcp://10.0.0.1:8786

CATALOGUE is a folder, a pattern in quotes, a CSV file with a column 'curve' or a TOML
file with tables [[objects]] that have a key 'curve'. Further columns: name; format tle
site error error_floor; model sampler seed num_starts and the other options of fit; any
other is an option of the model, as n_facets or spin. Options given here hold for objects
that do not say otherwise.

Exit status 3: objects failed, or results must not be trusted; objects.csv says which and
why. The same command again does what is not done, and tries again what failed.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("catalogue", metavar="CATALOGUE", help="CSV, TOML, folder or pattern")
    parser.add_argument(
        "-o", "--out", metavar="DIR", type=Path, required=True, help="folder for the results"
    )
    parser.add_argument("--model", metavar="NAME", help="of every object (default faceted)")
    parser.add_argument("--sampler", metavar="NAME", help="nuts (default), ahmc, smc …")
    add_model_arguments(parser, FLAGS)
    add_settings(parser, SETTINGS)
    add_reading_options(parser)
    parser.add_argument("--scheduler", metavar="ADDRESS", help="an existing Dask cluster: tcp://…")
    parser.add_argument("--workers", type=int, metavar="N", help="processes (default: the cores)")
    parser.add_argument("--reports", action="store_true", help="write the page of every object too")
    parser.add_argument("--no-report", action="store_true", help="write the numbers alone")
    parser.add_argument("--json", action="store_true", help="print batch.json on standard output")


def run(args: argparse.Namespace) -> int:
    if args.reports and args.no_report:
        raise InputError("--reports and --no-report are both given; choose one")
    named = ("model", "sampler", *SETTINGS, *READING)
    common = {k: getattr(args, k) for k in named if getattr(args, k) is not None}
    common |= model_options(args)

    from lcbayes.core.progress import Console, Silent
    from lcbayes.results.verdict import told
    from lcbayes.tasks.batch.run import batch

    found = batch(
        args.catalogue,
        out=args.out,
        common=common,
        scheduler=args.scheduler,
        workers=args.workers,
        reports=args.reports,
        progress=Silent() if args.json else Console(),
    )
    where = args.out if args.no_report else found.report(args.out)
    if args.json:
        sys.stdout.write((args.out / "batch.json").read_text(encoding="utf-8"))
        return EXIT_DONE if found.converged else EXIT_NOT_TRUSTED
    summary = found.summary()
    if not found.converged:
        print(told(found.reasons))
    print(
        f"{summary['n_objects']} objects: {summary['n_trusted']} trusted, "
        f"{summary['n_not_trusted']} not trusted, {summary['n_failed']} failed"
    )
    if summary["objects_per_hour"]:
        print(f"{summary['objects_per_hour']:.0f} objects per hour, {summary['workers']}")
    print(f"\n{'results' if args.no_report else 'report'}: {where}")
    return EXIT_DONE if found.converged else EXIT_NOT_TRUSTED
