"""Reasons against a result: a code for programs, a sentence for readers."""

from __future__ import annotations

import json
from typing import Any, NamedTuple


class Finding(NamedTuple):
    """What speaks against a result, before it is a sentence.

    Attributes
    ----------
    code : short identifier that does not change between versions, such as ``chains-disagree``
    values : what the sentence of that code names, all of them numbers or texts
    about : the part of the result that is meant, such as "solution 2"; empty for all of it
    """

    code: str
    values: dict[str, Any] = {}  # noqa: RUF012 - never changed
    about: str = ""

    def encode(self) -> str:
        """As text, for a checkpoint."""
        return json.dumps(self)

    @classmethod
    def decode(cls, text: str) -> Finding:
        """What `encode` gave."""
        return cls(*json.loads(text))


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
