"""`lcbayes fit CURVE -o DIR`: posterior and report."""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from pathlib import Path
from typing import Any

from lcbayes.cli.commands.model_options import (
    FLAGS,
    add_model_arguments,
    add_settings,
    model_options,
)
from lcbayes.cli.commands.reading import add_reading_arguments, how_read, read_from
from lcbayes.core.errors import EXIT_DONE, EXIT_NOT_TRUSTED, InputError
from lcbayes.results.load import read_config

LISTED = 24  # quantities of a solution on the terminal, and values of one quantity
HELP = "posterior over shape, spin and surface of one object, with a report"
EPILOG = """\
examples:
  lcbayes fit pass.csv -o out --n-facets 3 --seed 1
  lcbayes fit 43_Ariadne.lcs --model convex-grid --period 5.762 -o out
  lcbayes fit pass.csv -o out --n-facets 4 --sampler smc
  lcbayes fit starlink.csv -o out --model stabilised
  lcbayes fit pass.csv --tle object.tle -o out --model stabilised --law lvlh --facets +z,-x~5
  lcbayes fit pass.csv -o out --model ./mine.py --set depth=0.3
  lcbayes fit --config out/run.toml -o again        # the same numbers

A run that was stopped goes on when the same command is given again.
`lcbayes models NAME` lists the options of a model.
"""
SETTINGS = {
    "seed": "of every random number (default 0)",
    "num_warmup": "warm-up draws per chain (default 200 for nuts, more for others)",
    "num_samples": "draws kept per chain (default 750, and on to 3000 where they are not enough); "
    "for smc, particles that move (default 250)",
    "num_chains": "chains per solution (default 4); for smc, independent runs",
    "num_starts": "starts of the search (default: by the number of parameters)",
    "max_modes": "solutions to sample at most (default 4)",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_reading_arguments(parser, optional=True)
    parser.add_argument("-o", "--out", metavar="DIR", type=Path, help="folder for the results")
    parser.add_argument("--config", metavar="FILE", type=Path, help="run.toml of an earlier fit")
    parser.add_argument(
        "--model",
        metavar="NAME",
        help="faceted (default), faceted-brdf, convex-grid, stabilised, or a file",
    )
    parser.add_argument(
        "--sampler",
        metavar="NAME",
        help="nuts (default), ahmc, smc (many solutions), hmc, rmhmc, mh; ahmc-paper is biased",
    )
    add_model_arguments(parser, FLAGS)
    add_settings(parser, SETTINGS)
    parser.add_argument(
        "--start-from", metavar="DIR", help="start from the spins that lcbayes scan found there"
    )
    parser.add_argument("--no-report", action="store_true", help="write the numbers alone")
    parser.add_argument("--json", action="store_true", help="print summary.json on standard output")


def run(args: argparse.Namespace) -> int:
    keywords, expected = _configured(args)
    if args.out is None:
        raise InputError("where shall the results go? give a folder with -o DIR")
    for name in ("model", "sampler", "start_from", *SETTINGS):
        if getattr(args, name) is not None:
            keywords[name] = getattr(args, name)
    keywords |= model_options(args)
    if args.curve is None:
        raise InputError("give a light curve, or --config run.toml")
    curve = read_from(args)
    if expected and curve.source.get("sha256") != expected:
        raise InputError(
            f"{args.curve} has changed since {args.config} was written; to fit it as it is now, "
            f"name it: lcbayes fit {args.curve} --config {args.config} -o DIR"
        )

    from lcbayes.core.progress import Console, Silent
    from lcbayes.tasks.fit.run import fit

    progress = Silent() if args.json else Console()
    found = fit(
        curve,
        out=args.out,
        report=not args.no_report,
        progress=progress,
        reading=how_read(args),
        **keywords,
    )
    summary = found.summary()
    if args.json:
        json.dump(
            json.loads((args.out / "summary.json").read_text(encoding="utf-8")),
            sys.stdout,
            indent=1,
        )
        print()
    else:
        _tell(summary, bool(curve.free_scale.all()))
        written = ("results", "") if args.no_report else ("report", "report.html")
        print(f"\n{written[0]}: {args.out / written[1]}")
    return EXIT_DONE if summary["converged"] else EXIT_NOT_TRUSTED


def _configured(args: argparse.Namespace) -> tuple[dict[str, Any], str]:
    """Keywords from --config, and the digest of its light curve, which becomes that of ``args``
    with the options it was read with, unless another is given."""
    if args.config is None:
        return {}, ""
    kept = read_config(args.config)
    digest = ""
    if args.curve is None:
        args.curve, digest = kept.curve, kept.digest
        for name, value in kept.reading.items():
            setattr(args, name, value)
    return kept.keywords | kept.options, digest


def _tell(summary: dict[str, Any], relative: bool) -> None:
    """The result in a few lines on standard output."""
    from lcbayes.analysis.numerals import show
    from lcbayes.analysis.quantities import KNOWN
    from lcbayes.results.verdict import agreed, told

    modes = summary["modes"]
    if summary["converged"]:
        print(agreed([mode["weight"] for mode in modes]))
    else:
        print(told(summary["reasons"]))
    print("(mean ± standard deviation, and the interval that holds 90 %)")
    unit_of_rms = summary["fit"]["rms_unit"]
    for i, mode in enumerate(modes):
        print(f"solution {i + 1}: weight {mode['weight']:.3g}, rms {mode['rms']:.4g} {unit_of_rms}")
        rows = {
            name: row
            for name, row in mode["parameters"].items()
            if not name.startswith(("coefficients", "scale", "log_"))
        }
        entries = Counter(name.partition("[")[0] for name in rows)
        # of areas on a grid or offsets of many satellites no few say anything
        short = [name for name in rows if entries[name.partition("[")[0]] <= LISTED][:LISTED]
        for name in short:
            row, base = rows[name], name.partition("[")[0]
            unit = KNOWN.get(base, ("", "", 0.0))[1]
            if base == "albedo_area" and relative:
                unit = ""
            mean, sd, low, high = (show(row[k], row["sd"]) for k in ("mean", "sd", "q05", "q95"))
            print(f"  {name:22s} {f'{mean:>10s} ± {sd} {unit}':32s} {low} to {high}")
        if len(rows) > len(short):
            print(f"  … and {len(rows) - len(short)} more in summary.json")
