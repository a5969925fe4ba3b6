"""Bad input, as users meet it: one line that says what is wrong, and nothing written."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest

from lcbayes.cli import main
from lcbayes.core.errors import EXIT_BAD_INPUT


def assert_refused(
    argv: Sequence[str], out: Path, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """The command ends with 2 and one line on standard error that holds the message."""
    assert main.main(list(argv)) == EXIT_BAD_INPUT
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.count("\n") == 1
    assert message in printed.err
    assert not out.exists()
