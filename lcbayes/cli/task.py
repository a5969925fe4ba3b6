"""A task as a command: its arguments, its run, and what is printed."""

from __future__ import annotations

import sys
from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import Any

from lcbayes.cli.options import add_options, options_from
from lcbayes.core.errors import EXIT_DONE, EXIT_NOT_TRUSTED
from lcbayes.data.options import ReadOptions
from lcbayes.tasks.task import CURVE, Task


def add_arguments(parser: ArgumentParser, task: Task) -> None:
    """Add the source of a task, its options, the folder of its results, and what to print."""
    parser.add_argument("source", metavar=task.source.upper(), help=task.source_help)
    parser.add_argument(
        "-o", "--out", metavar="DIR", type=Path, required=True, help="folder for the results"
    )
    add_options(parser, task.options)
    if task.source == CURVE:
        add_options(parser, ReadOptions)
    parser.add_argument("--no-report", action="store_true", help="write the numbers alone")
    parser.add_argument("--json", action="store_true", help="print summary.json")


def run(args: Namespace, task: Task) -> int:
    """Run a task and print its result; returns the exit status."""
    import lcbayes
    from lcbayes.core.progress import Console, Silent

    function = getattr(lcbayes, task.function)
    result = function(
        source_from(args, task),
        out=args.out,
        report=not args.no_report,
        progress=Silent() if args.json else Console(),
        **options_from(args, task.options),
    )
    if args.json:
        sys.stdout.write((args.out / "summary.json").read_text(encoding="utf-8"))
    else:
        print(result.text())
        print(f"\n{'results' if args.no_report else 'report'}: {written(args)}")
    return EXIT_DONE if result.trusted else EXIT_NOT_TRUSTED


def source_from(args: Namespace, task: Task) -> Any:
    """The light curve of the command line, or the path that a task takes."""
    if task.source != CURVE:
        return args.source
    from lcbayes.data.read import read

    curve = read(args.source, **ReadOptions.of(options_from(args, ReadOptions)).as_dict())
    if task.fully_lit:
        from lcbayes.data.earth_shadow import FULL, fully_lit

        left_out = int(fully_lit(curve).source.get("in_penumbra", 0))
        if left_out:
            share = f"less than {100 * FULL:.0f} % of the sunlight past the Earth"
            print(f"note: {left_out} points that get {share} are left out", file=sys.stderr)
    return curve


def written(args: Namespace) -> Path:
    """Where to look at the result."""
    return args.out if args.no_report else args.out / "report.html"
