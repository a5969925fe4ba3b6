"""A task as a command: its arguments, its run, and what is printed."""

from __future__ import annotations

import shutil
import sys
import textwrap
from argparse import ArgumentParser, Namespace
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

from lcbayes.cli.options import add_options, options_from
from lcbayes.core.errors import EXIT_DONE, EXIT_NOT_TRUSTED, InputError
from lcbayes.data.options import ReadOptions
from lcbayes.tasks.task import CURVE, FILE, FOLDER, TEXT, Task


def add_arguments(parser: ArgumentParser, task: Task) -> None:
    """Add the source of a task, its options, what it writes, and what to print."""
    nargs = "?" if task.listing else None
    if task.source:
        name = task.source.upper()
        parser.add_argument("source", metavar=name, help=task.source_help, nargs=nargs)
    if task.out != TEXT:
        parser.add_argument(
            "-o",
            "--out",
            metavar="DIR" if task.out == FOLDER else "FILE",
            type=Path,
            required=task.listing is None,
            help=task.out_help,
        )
    add_options(parser, task.options)
    if task.source == CURVE:
        add_options(parser, ReadOptions)
    if task.listing:
        parser.add_argument("--list", action="store_true", help="print the names and stop")
    if task.out == FOLDER:
        parser.add_argument("--no-report", action="store_true", help="write the numbers alone")
        parser.add_argument("--json", action="store_true", help="print summary.json")


def run(args: Namespace, task: Task) -> int:
    """Run a task and print its result; returns the exit status."""
    if task.listing and args.list:
        print(task.listing())
        return EXIT_DONE
    if task.listing and (args.source is None or args.out is None):
        raise InputError(f"give a {task.source}, and with -o where the result goes; or --list")
    given = options_from(args, task.options)
    checked = task.options.of(given)  # before a file is read
    module = import_module(f"lcbayes.tasks.{task.function}.run")
    if task.out == TEXT:
        return module.command(source_from(args, task), checked)
    from lcbayes.core.progress import Console, Silent

    quiet = task.out == FOLDER and args.json
    report = {"report": not args.no_report} if task.out == FOLDER else {}
    result = getattr(module, task.function)(
        source_from(args, task),
        out=args.out,
        progress=Silent() if quiet else Console(),
        **report,
        **given,
    )
    _print(result, args, task)
    return EXIT_DONE if result.trusted else EXIT_NOT_TRUSTED


def _print(result: Any, args: Namespace, task: Task) -> None:
    if task.out == FOLDER and args.json:
        sys.stdout.write((args.out / "summary.json").read_text(encoding="utf-8"))
        return
    width = shutil.get_terminal_size().columns if sys.stdout.isatty() else None
    for line in result.text().splitlines():
        print(line if width is None else wrapped(line, width))
    if task.out == FILE:
        return
    if args.no_report:
        print(f"\nresults: {args.out}")
    else:
        print(f"\nreport: {args.out / 'report.html'}")


def wrapped(line: str, width: int) -> str:
    """A line within the width; what is carried over is indented by two more than its start."""
    hanging = " " * (len(line) - len(line.lstrip()) + 2)
    return textwrap.fill(
        line, width, subsequent_indent=hanging, break_long_words=False, break_on_hyphens=False
    )


def source_from(args: Namespace, task: Task) -> Any:
    """The light curve of the command line, the path that a task takes, or None."""
    if task.source != CURVE:
        return args.source if task.source else None
    from lcbayes.data.read import read

    curve = read(args.source, **reading_options(args))
    if task.fully_lit:
        from lcbayes.data.earth_shadow import FULL, fully_lit

        left_out = int(fully_lit(curve).source.get("in_penumbra", 0))
        if left_out:
            share = f"less than {100 * FULL:.0f} % of the sunlight past the Earth"
            print(f"note: {left_out} points that get {share} are left out", file=sys.stderr)
    return curve


def reading_options(args: Namespace) -> Mapping[str, Any]:
    """What was said about how the light curve is to be read."""
    return ReadOptions.of(options_from(args, ReadOptions)).as_dict()
