"""`lcbayes report DIR`: write the report of a finished run again."""

from __future__ import annotations

import argparse
from pathlib import Path

from lcbayes.core.errors import EXIT_DONE

HELP = "write report.html, figures/ and shape.obj of a results folder again"
EPILOG = """\
example:
  lcbayes report out
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "folder", metavar="DIR", type=Path, help="a folder written by `lcbayes fit`"
    )


def run(args: argparse.Namespace) -> int:
    from lcbayes.analysis import report

    print(report.write(args.folder))
    return EXIT_DONE
