"""`lcbayes observability SCENARIO -o DIR`: what a campaign can know before it is flown."""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import textwrap
from pathlib import Path

from lcbayes.core.errors import EXIT_DONE, InputError

HELP = "what the measurements of a scenario can tell before they are taken, and which to take"
EPILOG = """\
examples:
  lcbayes observability box-wing -o out
  lcbayes observability mine.toml -o out --unknown attitude,spin
  lcbayes observability mine.toml -o out --plan 20 --target pole --visit 30
  lcbayes observability tomorrow.toml -o out --plan 20 --target normal:2 --posterior fit

Written: observability.json, observability.html, figures/ and, with --plan,
schedule.csv. The epochs that can be observed are those of the scenario's geometry:
for orbits, where the satellite is high enough and sunlit and the site is dark.
"""
TARGETS = "pole, a group, normal:I for facet I, the name of a parameter, or all"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "scenario", metavar="SCENARIO", help="a TOML file, or a name from lcbayes simulate --list"
    )
    parser.add_argument(
        "-o", "--out", metavar="DIR", type=Path, required=True, help="folder for the results"
    )
    parser.add_argument(
        "--unknown",
        metavar="GROUP,...",
        default="spin,normals,areas,surface",
        help="what is not known: attitude, spin, normals, areas, surface (default: the last four)",
    )
    parser.add_argument("--plan", type=int, metavar="N", help="choose the best N visits")
    parser.add_argument(
        "--target", default="pole", help=f"what the plan is to find out: {TARGETS} (default pole)"
    )
    parser.add_argument(
        "--criterion",
        choices=("A", "D"),
        default="A",
        help="A: least mean variance (default); D: most information",
    )
    parser.add_argument(
        "--visit",
        type=float,
        default=0.0,
        metavar="SECONDS",
        help="length of a visit (default 0: single measurements)",
    )
    parser.add_argument(
        "--posterior", type=Path, metavar="DIR", help="plan with what an earlier fit knows"
    )
    parser.add_argument(
        "--json", action="store_true", help="print observability.json on standard output"
    )


def run(args: argparse.Namespace) -> int:
    if args.plan is not None and args.plan < 1:
        raise InputError(f"--plan is {args.plan}; expected a number of visits >= 1")
    if args.posterior is not None and args.plan is None:
        raise InputError("--posterior is for planning; say how many visits with --plan N")
    if not args.visit >= 0.0:
        raise InputError(f"--visit is {args.visit:g}; expected seconds >= 0")
    if (args.out / "posterior.nc").exists():
        raise InputError(f"{args.out} holds a fit; give another folder with -o")

    from lcbayes.analysis import observability_page as page
    from lcbayes.core.progress import Console, Silent
    from lcbayes.simulation.observability import summary
    from lcbayes.simulation.scenarios.scenario import load
    from lcbayes.tasks.observability.run import judge

    scenario = load(args.scenario)
    progress = Silent() if args.json else Console()
    found = judge(
        scenario,
        [group.strip() for group in args.unknown.split(",")],
        n_visits=args.plan,
        target=args.target,
        criterion=args.criterion,
        visit_s=args.visit,
        posterior=args.posterior,
        progress=progress,
    )
    command = ["observability", args.scenario, "--unknown", args.unknown]
    if args.plan is not None:
        command += ["--plan", args.plan, "--target", args.target, "--criterion", args.criterion]
        command += ["--visit", f"{args.visit:g}"]
        command += ["--posterior", args.posterior] if args.posterior else []
    content = page.write(found, args.out, command)
    if args.json:
        json.dump(json.loads(content.read_text(encoding="utf-8")), sys.stdout, indent=1)
        print()
    else:
        width = shutil.get_terminal_size().columns
        print("\n".join(wrapped(line, width) for line in summary.words(found)))
        print(f"\nresults: {args.out}")
    return EXIT_DONE


def wrapped(line: str, width: int) -> str:
    """A line within the width, what is carried over set in by two more than its start."""
    hanging = " " * (len(line) - len(line.lstrip()) + 2)
    return textwrap.fill(
        line, width, subsequent_indent=hanging, break_long_words=False, break_on_hyphens=False
    )
