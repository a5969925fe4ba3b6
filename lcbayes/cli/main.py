"""The command `lcbayes`: subcommands, exit status, and one-line error messages."""

from __future__ import annotations

import argparse
import io
import os
import sys
from collections.abc import Sequence
from functools import partial
from importlib import import_module

from lcbayes.cli.parser import Parser, join_negative_values, unknown_command, unknown_words
from lcbayes.core.errors import EXIT_BAD_INPUT, EXIT_INTERRUPTED, InputError

COMMANDS = {  # here, and not in the tasks, so that `lcbayes --help` imports none of them
    "look": "what a light curve holds, its candidate periods, and what could be asked of it",
    "simulate": "make a light curve from a scenario file, or from a bundled scenario",
    "fit": "posterior over shape, spin and surface of one object, with a report",
    "compare": "how many facets, or which body: evidence, left-out epochs and probability of each",
    "albedo-area": (
        "albedo-area distribution, shape cues and convex shape of an object of known attitude"
    ),
    "scan": (
        "hypotheses of attitude (pole, period, stabilised laws), each with its best body, ranked"
    ),
    "spin": "sidereal period and pole of a spinning object from its periods alone, without a shape",
    "glints": (
        "find glints and turn them into directions of facets, cylinders or Sun-tracking panels"
    ),
    "single-facet": "orientation of one large facet from the brightening or dimming at its edge",
    "attitude-test": (
        "test attitude laws by pairs of measurements with equal geometry, without a shape"
    ),
    "shape-match": (
        "match the distribution of brightness over phase angle to shapes, without an attitude"
    ),
    "observability": (
        "what the measurements of a scenario determine before they are taken; which to take"
    ),
    "predict": "brightness, rotation or outline of the body that a fit predicts",
    "batch": "fit of every object of a catalogue, resumable, on this machine or on a Dask cluster",
    "survey": (
        "probable periods and poles of every object of a catalogue of sparse points, in one table"
    ),
    "report": "write report.html, figures/ and the shape of a results folder again",
    "convert": "rewrite a light curve as CSV or ECSV, with directions to Sun and observer",
    "models": "list the models, or the options of one",
    "doctor": "check this installation and machine, and say what to do where something is wrong",
}

EPILOG = """\
examples:
  lcbayes look pass.csv
  lcbayes fit pass.csv -o out --n-facets 3
  lcbayes fit 43_Ariadne.lcs --model convex-grid --period 5.762 -o out
  lcbayes predict out tomorrow.csv -o brightness.csv

exit status: 0 done; 2 the input is at fault; 3 done, but the result must not be
trusted (the report says why); 130 interrupted
"""


def _parser(words: Sequence[str] | None = None) -> Parser:
    """The parser of all commands, or only of what `words` need, which is several times faster."""
    needs_no_arguments = words is not None and list(words) in ([], ["-h"], ["--help"])
    asked = words[0] if words and words[0] in COMMANDS else None
    parser = Parser(
        prog="lcbayes",
        description="Facets, spin and surface of an unresolved space object from its light curve.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="store_true", help="print the version and exit")
    parser.add_argument(
        "--completion", metavar="SHELL", help="print completions for bash, zsh or fish, and exit"
    )
    commands = parser.add_subparsers(dest="command", metavar="COMMAND")
    for name in (asked,) if asked else COMMANDS:
        summary = COMMANDS[name]
        about = summary[0].upper() + summary[1:] + "."
        command = commands.add_parser(
            name,
            help=summary,
            description=about,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        if not needs_no_arguments:
            _add_task(command, name)
    return parser


def _add_task(command: Parser, name: str) -> None:
    from lcbayes.cli import task

    declared = import_module(f"lcbayes.tasks.{name.replace('-', '_')}.options").TASK
    command.epilog = declared.details
    task.add_arguments(command, declared)
    command.set_defaults(run=partial(task.run, task=declared), parser=command)


def _print_completion(shell: str, parser: Parser) -> int:
    from lcbayes.cli.completion import script

    try:
        print(script(shell, parser), end="")
    except InputError as fault:
        print(f"lcbayes: {fault}", file=sys.stderr)
        return EXIT_BAD_INPUT
    return 0


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command; returns its exit status."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:  # closed by the caller, so output is discarded
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115 - stays open
        elif isinstance(stream, io.TextIOWrapper):  # a terminal may not show all characters
            stream.reconfigure(errors="backslashreplace")
    words = join_negative_values(sys.argv[1:] if argv is None else argv)
    if words and not words[0].startswith("-") and words[0] not in COMMANDS:
        print(f"lcbayes: {unknown_command(words[0], COMMANDS)}", file=sys.stderr)
        return EXIT_BAD_INPUT
    parser = _parser(words)
    try:
        args, unknown = parser.parse_known_args(words)
    except SystemExit as stop:  # argparse has printed the error
        return int(stop.code or 0)
    if unknown:
        used = getattr(args, "parser", parser)
        print(f"{used.prog}: {unknown_words(unknown, used)}", file=sys.stderr)
        return EXIT_BAD_INPUT
    if args.version:
        from lcbayes.core.version import installed_version

        print(f"lcbayes {installed_version()}")
        return 0
    if args.completion is not None:
        return _print_completion(args.completion, parser)
    if args.command is None:
        parser.print_help()
        return EXIT_BAD_INPUT
    try:
        status = args.run(args)
        sys.stdout.flush()  # here, so that a failure gives a one-line message
        return status
    except InputError as fault:
        print(f"lcbayes {args.command}: {fault}", file=sys.stderr)
        return EXIT_BAD_INPUT
    except KeyboardInterrupt:
        print("\nlcbayes: interrupted; the same command goes on where it stopped", file=sys.stderr)
        return EXIT_INTERRUPTED
    except BrokenPipeError:  # the reader has closed the pipe
        _drop_output()
        return EXIT_INTERRUPTED
    except OSError as fault:  # a full disk, a folder that was removed
        said = f"{fault.filename}: {fault.strerror}" if fault.filename else str(fault)
        print(
            f"lcbayes {args.command}: {' '.join(said.split())}; what was there before is as it "
            "was: make room, or choose another place, and give the same command again",
            file=sys.stderr,
        )
        try:
            sys.stdout.flush()
        except OSError:  # the disk of standard output is full
            _drop_output()
        return EXIT_BAD_INPUT


def _drop_output() -> None:
    """Discard pending standard output, so that Python does not fail when it exits."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


if __name__ == "__main__":
    sys.exit(main())
