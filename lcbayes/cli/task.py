"""A task as a command: arguments, run and printed output."""

from __future__ import annotations

import shutil
import sys
import textwrap
from argparse import ArgumentParser, Namespace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lcbayes.cli.options import add_options, options_from
from lcbayes.core.errors import EXIT_DONE, EXIT_NOT_TRUSTED, InputError
from lcbayes.data.options import ReadOptions
from lcbayes.tasks.task import CURVE, FILE, FOLDER, REQUIRED_FOLDER, SOURCE, TEXT, Task

if TYPE_CHECKING:
    from lcbayes.results.record import Record
    from lcbayes.results.result import Result


def add_arguments(parser: ArgumentParser, task: Task) -> None:
    """Add the arguments for the source of a task, its options, its files and its output."""
    again = task.source == CURVE and task.out in (FOLDER, REQUIRED_FOLDER)
    if task.source:
        nargs = "?" if again or task.listing else None
        parser.add_argument(
            "source", metavar=task.source.upper(), nargs=nargs, help=task.source_help
        )
    if task.out not in (TEXT, SOURCE):
        metavar = "FILE" if task.out == FILE else "DIR"
        parser.add_argument("-o", "--out", metavar=metavar, type=Path, help=task.out_help)
    if again:
        parser.add_argument(
            "--config", metavar="FILE", type=Path, help="run.toml of an earlier run, to run again"
        )
    add_options(parser, task.options)
    if task.has_model_options:
        parser.add_argument(
            "--set",
            action="append",
            default=[],
            metavar="NAME=VALUE",
            help="another option of the model",
        )
    if task.source == CURVE:
        add_options(parser, ReadOptions)
    if task.listing:
        parser.add_argument("--list", action="store_true", help="print the names and stop")
    if task.out in (FOLDER, REQUIRED_FOLDER):
        parser.add_argument("--no-report", action="store_true", help="write the numbers alone")
    if task.out in (FOLDER, REQUIRED_FOLDER, SOURCE):
        parser.add_argument("--json", action="store_true", help="print summary.json")


def run(args: Namespace, task: Task) -> int:
    """Run a task and print its result; returns the exit status."""
    if task.listing and args.list:
        print(task.listing())
        return EXIT_DONE
    if task.listing and (args.source is None or args.out is None):
        raise InputError(f"give a {task.source}, and with -o where the result goes; or --list")
    if task.out not in (TEXT, SOURCE) and args.out is None and not task.prints:
        what = "a file with -o FILE" if task.out == FILE else "a folder with -o DIR"
        raise InputError(f"no place for the results was given; give {what}")
    record = _record(args, task)
    options = {} if record is None else dict(record.options)
    options |= options_from(args, task.options)
    if task.has_model_options:
        options |= _pairs(args.set)
    checked = task.options.of(options)  # before any file is read
    source = source_from(args, task, record)
    module = import_module(f"lcbayes.tasks.{task.function}.run")
    if task.out == TEXT:
        return module.command(source, checked)

    from lcbayes.core.progress import Console, Silent

    quiet = getattr(args, "json", False)
    writing = {} if task.out == SOURCE else {"out": args.out}
    if task.out in (FOLDER, REQUIRED_FOLDER):
        writing["report"] = not args.no_report
    result = getattr(module, task.function)(
        source, **writing, progress=Silent() if quiet else Console(), **options
    )
    if task.source == CURVE and not quiet:  # a refusal is one line, so they come last
        for note in filter(None, source.source.get("notes", "").split("; ")):
            print(f"note: {note}", file=sys.stderr)
    _print(args, task, result)
    return EXIT_DONE if result.trusted else EXIT_NOT_TRUSTED


def _print(args: Namespace, task: Task, result: Result) -> None:
    folder = Path(args.source) if task.out == SOURCE else args.out
    if getattr(args, "json", False):
        from lcbayes.core.files import json_text

        path = None if folder is None else folder / "summary.json"
        sys.stdout.write(path.read_text(encoding="utf-8") if path else json_text(result.content))
        return
    if task.out == SOURCE:
        print(folder / "report.html")
        return
    width = shutil.get_terminal_size().columns if sys.stdout.isatty() else None
    for line in result.text().splitlines():
        print(line if width is None else wrapped(line, width))
    if task.out == FILE or args.out is None:
        return
    if args.no_report:
        print(f"\nresults: {folder}")
    else:
        print(f"\nreport: {folder / 'report.html'}")


def wrapped(line: str, width: int) -> str:
    """A line wrapped to the width; continuation lines are indented by two more than its start."""
    hanging = " " * (len(line) - len(line.lstrip()) + 2)
    return textwrap.fill(
        line, width, subsequent_indent=hanging, break_long_words=False, break_on_hyphens=False
    )


def _pairs(given: list[str]) -> dict[str, str]:
    """The options of ``--set NAME=VALUE``."""
    options = {}
    for pair in given:
        name, equals, value = pair.partition("=")
        if not equals:
            raise InputError(f"--set {pair}: expected NAME=VALUE, such as --set omega_sd=0.2")
        options[name.strip().replace("-", "_")] = value.strip()
    return options


def _record(args: Namespace, task: Task) -> Record | None:
    """The record of the run to repeat, after a check that its inputs are unchanged."""
    if getattr(args, "config", None) is None:
        return None
    from lcbayes.results.record import read_record

    record = read_record(args.config)
    if record.task != task.name:
        raise InputError(
            f"{args.config} is of lcbayes {record.task}; run it with lcbayes {record.task} --config"
        )
    given = options_from(args, task.options)
    if "model" in record.options and "model" in given:
        if "model" in record.inputs:  # a file: only the one that was used gives the same result
            record.model(given["model"])
    elif "model" in record.options:
        record.model(None)
    elsewhere = {"curve", "tle"} if args.source is not None else set()
    record.check_inputs("model", *elsewhere, *(name for name in given if name in record.inputs))
    return record


def source_from(args: Namespace, task: Task, record: Record | None = None) -> Any:
    """The source from the command line or an earlier run: a light curve, a path, or None."""
    if task.source != CURVE:
        return args.source if task.source else None
    from lcbayes.data.read import read
    from lcbayes.tasks.task import fitted_curve

    path, reading = args.source, options_from(args, ReadOptions)
    if path is None:
        if record is None:
            raise InputError("no light curve was given; give CURVE, or --config run.toml")
        path, reading = record.source(CURVE), record.reading | reading
    if Path(path).is_dir():
        if not (Path(path) / "posterior.nc").is_file():
            raise InputError(f"{path} is a folder; give a file, or the folder of a fit")
        return fitted_curve(Path(path))
    curve = read(path, **ReadOptions.of(reading).as_dict(), geometry=task.geometry)
    if task.fully_lit:
        from lcbayes.data.earth_shadow import FULL, fully_lit

        left_out = int(fully_lit(curve).source.get("in_penumbra", 0))
        if left_out:
            share = f"less than {100 * FULL:.0f} % of the sunlight past the Earth"
            print(f"note: {left_out} points that get {share} are left out", file=sys.stderr)
    return curve
