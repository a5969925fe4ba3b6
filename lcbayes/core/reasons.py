"""Reasons against a result: a code for programs, a sentence for readers."""

from __future__ import annotations

from typing import NamedTuple


class Reason(NamedTuple):
    """Why a result must not be trusted.

    Attributes
    ----------
    code : short identifier that does not change between versions, such as ``chains-disagree``
    text : one sentence
    """

    code: str
    text: str

    def __str__(self) -> str:
        return self.text
