"""Several stages shown as one."""

from __future__ import annotations

import pytest

from lcbayes.progress import Parts


class Noted:
    def __init__(self) -> None:
        self.done, self.notes = 0, []

    def advance(self, n: int, note: str = "") -> None:
        assert n >= 0
        self.done += n
        self.notes.append(note)


def test_parts_count_by_their_cost():
    track = Noted()
    parts = Parts(track, 100, 8.0)
    with parts.part(2.0, "small", 2) as within:
        for half_way in (6, 18):
            with within.stage("tempering", 50, "%") as stage:
                stage.advance(25, "half")
                assert track.done == half_way
                stage.advance(25)
    assert track.notes[0] == "small, half"
    with parts.part(6.0, "large", 3):
        pass  # nothing to do: it was stored
    assert track.done == 100


def test_a_part_that_fails_is_over():
    track = Noted()
    parts = Parts(track, 100, 4.0)
    with (
        pytest.raises(ZeroDivisionError),
        parts.part(1.0, "one", 1) as within,
        within.stage("tempering", 100, "%") as stage,
    ):
        stage.advance(1 // 0)
    assert track.done == 25


def test_it_never_goes_back():
    """More turns out to be needed on the way: it waits, and ends at the whole all the same."""
    track = Noted()
    parts = Parts(track, 100, 4.0)
    with parts.part(3.0, "one", 1):
        pass
    parts.total = 10.0
    for done in (75, 100):
        with parts.part(3.5, "more", 1):
            pass
        assert track.done == done
