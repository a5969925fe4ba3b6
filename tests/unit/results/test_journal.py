"""The journal of a survey: finished objects outlive any kill, and nothing is found twice."""

from __future__ import annotations

import pytest

from lcbayes.core.errors import InputError
from lcbayes.results.journal import Journal

A, B, C = "00000000000000aa", "ffffffffffffffff", "0000000000000001"


@pytest.fixture
def path(tmp_path):
    return tmp_path / "objects.jsonl"


def test_objects_are_found_again(path):
    with Journal(path) as journal:
        places = [
            journal.add(key, {"name": name}) for key, name in ((A, "a"), (B, "b"), (C, "ü\n"))
        ]
        assert journal.read(places[2]) == {"key": C, "final": 1, "name": "ü\n"}
    with Journal(path) as again:
        assert [again.find(key) for key in (A, B, C)] == places
        assert again.find("00000000000000ab") is None
        assert again.read(places[0])["name"] == "a"
        assert again.add("00000000000000ab", {}) > places[-1]  # reading does not move the end


@pytest.mark.parametrize("cut", [1, 9, 30])
def test_an_incomplete_line_is_removed(path, cut):
    with Journal(path) as journal:
        place = journal.add(A, {"name": "a"})
        end = journal.add(B, {"name": "b", "reasons": ["two words"]})
    path.write_bytes(path.read_bytes()[:-cut])
    with Journal(path) as again:
        assert again.find(A) == place
        assert again.find(B) is None
        assert again.add(B, {"name": "b"}) == end
    with Journal(path) as again:
        assert again.read(end)["name"] == "b"


def test_what_is_not_final_is_not_found_and_the_last_line_counts(path):
    with Journal(path) as journal:
        journal.add(A, {"name": "stopped"}, final=False)
        journal.add(B, {"name": "first"})
        last = journal.add(B, {"name": "second"})
    with Journal(path) as again:
        assert again.find(A) is None
        assert again.find(B) == last


def test_another_file_is_left_as_it_was(path):
    path.write_text("name,curve\n")
    with pytest.raises(InputError, match="no journal of a survey"):
        Journal(path)
    assert path.read_text() == "name,curve\n"
