"""Command-line parser whose errors are one line with the remedy."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from typing import Any, NoReturn

from lcbayes.core.errors import EXIT_BAD_INPUT
from lcbayes.core.text import closest


class Parser(argparse.ArgumentParser):
    """A parser of complete option names; an abbreviation would change its meaning when an option
    is added."""

    def __init__(self, *args: Any, **given: Any) -> None:
        super().__init__(*args, allow_abbrev=False, **given)

    def error(self, message: str) -> NoReturn:
        message = message.removeprefix("argument ")
        self.exit(EXIT_BAD_INPUT, f"{self.prog}: {message}; see {self.prog} --help\n")

    @property
    def options(self) -> list[str]:
        """Names of the long options."""
        names = (name for action in self._actions for name in action.option_strings)
        return [name for name in names if name.startswith("--")]


def unknown_command(word: str, commands: Iterable[str]) -> str:
    """The message about a command that does not exist."""
    commands = list(commands)
    return f"unknown command {word!r}{closest(word, commands)}; available: {', '.join(commands)}"


def unknown_words(words: Sequence[str], parser: Parser) -> str:
    """The message about words that a command does not take."""
    given = [word for word in words if word.startswith("-") and len(word) > 1]
    if not given:
        return f"unexpected argument {words[0]!r}; quote names with spaces, or see {parser.prog} -h"
    name = given[0].split("=")[0]
    return f"unknown option {name}{closest(name, parser.options)}; see {parser.prog} --help"


def join_negative_values(argv: Sequence[str]) -> list[str]:
    """``--site -47.06,15.49,490`` as ``--site=-47.06,15.49,490``.

    Otherwise a value that begins with a minus sign and a digit would be read as an option.
    """
    joined: list[str] = []
    for word in argv:
        negative = word[:1] == "-" and word[1:2] in ".0123456789" and len(word) > 1
        option = bool(joined) and joined[-1].startswith("--") and "=" not in joined[-1]
        if negative and option:
            joined[-1] += f"={word}"
        else:
            joined.append(word)
    return joined
