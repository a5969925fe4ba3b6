"""Usual mistakes of users are noticed: one line that says what is wrong and what to do."""

from __future__ import annotations

from pathlib import Path

import pytest

from docs import make_mistakes
from tests.helpers import mistakes
from tests.helpers.mistakes import MISTAKES, Answer, Mistake

ROOT = Path(__file__).resolve().parents[2]
ALL = [mistake for group in MISTAKES.values() for mistake in group]


@pytest.fixture(scope="module")
def answered(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Answer]:
    return mistakes.answers(tmp_path_factory.mktemp("mistakes"))


def test_there_are_forty_different_ones() -> None:
    assert len({mistake.what for mistake in ALL}) == len(ALL) >= 40


@pytest.mark.parametrize("mistake", ALL, ids=lambda mistake: mistake.what)
def test_a_mistake_is_noticed(mistake: Mistake, answered: dict[str, Answer]) -> None:
    answer = answered[mistake.what]
    assert answer.status == mistake.status, answer.message
    for said in mistake.says:
        assert said in answer.message
    assert answer.made <= ({"out.csv"} if mistake.noticed else set())


def test_the_page_shows_these_messages(answered: dict[str, Answer]) -> None:
    """`python docs/make_mistakes.py` writes it."""
    page = (ROOT / "docs" / "mistakes.md").read_text("utf-8")
    assert page == make_mistakes.page(answered)
