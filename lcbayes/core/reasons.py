"""Reasons against a result: a code for programs, a sentence for readers."""

from __future__ import annotations

from typing import NamedTuple


class Reason(NamedTuple):
    """One reason of a verdict.

    Attributes
    ----------
    code : short identifier in kebab case, the same whatever the numbers are
    text : one sentence

    Examples
    --------
    >>> str(Reason("too-few-cycles", "the longest pass holds 4.1 cycles"))
    'the longest pass holds 4.1 cycles'
    """

    code: str
    text: str

    def __str__(self) -> str:
        return self.text
