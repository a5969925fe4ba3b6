"""Reasons against a result: a code for programs, a sentence for readers."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
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


def coded(reasons: Iterable[str | Reason], codes: Mapping[str, str]) -> list[Reason]:
    """Reasons with codes, where a method gives some of them as sentences alone.

    Parameters
    ----------
    codes : code → phrase that only the sentences of this code contain

    Raises
    ------
    KeyError
        No phrase matches a sentence.

    Examples
    --------
    >>> coded(["the pass has 3 points"], {"too-few-points": "points"})
    [Reason(code='too-few-points', text='the pass has 3 points')]
    """
    return [r if isinstance(r, Reason) else Reason(_code(r, codes), r) for r in reasons]


def _code(sentence: str, codes: Mapping[str, str]) -> str:
    for code, phrase in codes.items():
        if phrase in sentence:
            return code
    raise KeyError(f"no code for the reason {sentence!r}")
