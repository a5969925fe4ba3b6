"""`lcbayes scan CURVE -o DIR`: hypotheses of attitude, ranked."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from lcbayes.cli.commands.model_options import add_settings
from lcbayes.cli.commands.reading import add_reading_arguments, how_read, read_lit
from lcbayes.core.errors import EXIT_DONE, EXIT_NOT_TRUSTED, InputError

HELP = "hypotheses of attitude (pole, period, stabilised laws), each with its best body, ranked"
EPILOG = """\
examples:
  lcbayes scan 43_Ariadne.lcs --period-range 5.75,5.775 -o out
  lcbayes scan 43_Ariadne.lcs --period 5.762 -o out
  lcbayes scan tumbler.csv --tle object.tle --period-range 20s,300s --n-poles 24 -o out
  lcbayes scan passes.csv --tle object.tle --law all -o out
  lcbayes scan 43_Ariadne.lcs --period-range 5,6 --scheduler tcp://10.0.0.1:8786 -o out
  lcbayes fit 43_Ariadne.lcs --model convex-grid --start-from out -o posterior

Periods are sidereal, in hours, or with a unit: 30s, 12min, 5.76h, 2d. A scan ranks;
how well a spin is known, `lcbayes fit --start-from DIR` says. A run that was stopped
goes on when the same command is given again.
"""
UNITS = {"s": 1.0 / 3600.0, "min": 1.0 / 60.0, "h": 1.0, "d": 24.0}
SETTINGS = {
    "n_poles": "poles to start from (default 12)",
    "n_facets": "facets of the body of refined solutions (default 500)",
    "degree": "degree of its harmonics (default 6)",
    "keep": "solutions to refine (default 12)",
    "n_sky": "poles of the map of the sky (default 200); 0: no map",
    "workers": "processes of a local Dask cluster",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_reading_arguments(parser)
    parser.add_argument(
        "-o", "--out", metavar="DIR", type=Path, required=True, help="folder for the results"
    )
    parser.add_argument("--period", metavar="P", help="sidereal period of a spin, h (or 30s)")
    parser.add_argument("--period-range", metavar="FROM,TO", help="periods to try, h (or 20s,90s)")
    parser.add_argument(
        "--period-step",
        type=float,
        default=0.8,
        metavar="X",
        help="between trial periods, in half turns over the data (default 0.8)",
    )
    parser.add_argument(
        "--law",
        action="append",
        metavar="NAME",
        help="a stabilised attitude, or all; may be given several times",
    )
    parser.add_argument(
        "--reflectance",
        metavar="LAW",
        help="lambertian, non-lambertian (default) or lommel-seeliger-lambert (for asteroids)",
    )
    parser.add_argument(
        "--common-noise",
        action="store_true",
        help="errors unknown: one relative noise level, not one for each curve",
    )
    add_settings(parser, SETTINGS)
    parser.add_argument("--scheduler", metavar="ADDRESS", help="an existing Dask cluster: tcp://…")
    parser.add_argument("--no-report", action="store_true", help="write the numbers alone")
    parser.add_argument("--json", action="store_true", help="print summary.json on standard output")


def run(args: argparse.Namespace) -> int:
    period = None if args.period is None else hours("--period", args.period)
    between = None
    if args.period_range is not None:
        ends = args.period_range.split(",")
        if len(ends) != 2:
            raise InputError(f"--period-range is {args.period_range!r}; give FROM,TO, as 5.7,5.8")
        between = (hours("--period-range", ends[0]), hours("--period-range", ends[1]))
    curve = read_lit(args)

    from lcbayes.core.progress import Console, Silent
    from lcbayes.results.verdict import told
    from lcbayes.tasks.scan.run import scan

    found = scan(
        curve,
        period_h=period,
        period_range_h=between,
        laws=args.law,
        reflectance=args.reflectance,
        period_step=args.period_step,
        common_noise=args.common_noise,
        scheduler=args.scheduler,
        out=args.out,
        report=not args.no_report,
        progress=Silent() if args.json else Console(),
        reading=how_read(args),
        **{k: getattr(args, k) for k in SETTINGS if getattr(args, k) is not None},
    )
    if args.json:
        sys.stdout.write((args.out / "summary.json").read_text(encoding="utf-8"))
    else:
        if not found.converged:
            print(told(found.reasons))
        print("\n".join(_lines(found.summary())))
        written = ("results", "") if args.no_report else ("report", "report.html")
        print(f"\n{written[0]}: {args.out / written[1]}")
    return EXIT_DONE if found.converged else EXIT_NOT_TRUSTED


def hours(option: str, text: str) -> float:
    """A length of time in hours, from a number of hours or one with a unit."""
    text = text.strip()
    number = text.rstrip("abcdefghijklmnopqrstuvwxyz") if text[-1:].isalpha() else text
    unit = text[len(number) :].strip() or "h"
    try:
        return float(number) * UNITS[unit]
    except (KeyError, ValueError):
        raise InputError(
            f"{option} has {text!r}; give hours, or a number with s, min, h or d, such as 30s"
        ) from None


def _lines(summary: dict[str, Any]) -> list[str]:
    """The result on standard output."""
    from lcbayes.inversion.attitude_scan.result import written_period

    lines = [
        f"{summary['n_hypotheses']} hypotheses: {summary['n_periods']} periods, "
        f"{summary['n_laws']} laws; the best of them:"
    ]
    lines.append("     lon      lat         period        chi2     rms")
    for i, s in enumerate(summary["solutions"], start=1):
        what = f"{s['law']:29s}"
        if "period_h" in s:
            period = written_period(s["period_h"], s["period_resolution_h"])
            what = f"{s['pole_lon_deg']:6.1f}  {s['pole_lat_deg']:+6.1f}  {period:>13s}"
        mark = "=" if s["near_equal"] else " "
        lines.append(f"{i:2d}{mark}{what}  {s['chi2']:10.5g}  {s['rms']:6.4f}  {s['words']}")
    limit = summary["fit"]["chi2_near_equal"]
    lines.append(
        f"= fits as well as the best: chi2 up to {limit:.5g} is noise, or 5 % of residuals"
    )
    return lines
