"""The conditions of a stable period, as content of a summary."""

from __future__ import annotations

from typing import TypedDict

from lcbayes.inversion.spin.sidereal import Condition
from lcbayes.results.reasons import condition


class ConditionContent(TypedDict):
    """A condition of the method; the code is empty where it is met."""

    name: str
    met: bool
    words: str
    code: str


def condition_content(c: Condition) -> ConditionContent:
    """A condition as content of a summary."""
    return {
        "name": c.name,
        "met": c.met,
        "words": condition(c.finding, met=c.met),
        "code": "" if c.met else c.finding.code,
    }
