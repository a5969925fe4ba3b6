"""Reasons to doubt or reject a result: a code for programs, a sentence for readers."""

from __future__ import annotations

import json
from typing import Any, NamedTuple, TypedDict


class ReasonContent(TypedDict):
    """A reason not to trust a result, in ``summary.json``."""

    code: str
    text: str


class Finding(NamedTuple):
    """A reason to doubt or reject a result, before it is put into a sentence.

    Attributes
    ----------
    code : short identifier that does not change between versions, such as ``chains-disagree``
    values : numbers and strings that appear in the sentence of that code
    about : the part of the result concerned, such as "solution 2"; empty for the whole result
    """

    code: str
    values: dict[str, Any] = {}  # noqa: RUF012 - never changed
    about: str = ""

    def encode(self) -> str:
        """As text, for a checkpoint."""
        return json.dumps(self)

    @classmethod
    def decode(cls, text: str) -> Finding:
        """The finding from the text written by `encode`."""
        return cls(*json.loads(text))


class Reason(NamedTuple):
    """One reason for a verdict.

    Attributes
    ----------
    code : short identifier in kebab case, independent of the values
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

    @property
    def content(self) -> ReasonContent:
        """The reason as written to ``summary.json``."""
        return {"code": self.code, "text": self.text}
