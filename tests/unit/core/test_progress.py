"""Several stages shown as one."""

from __future__ import annotations

import io
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from lcbayes.core.errors import InputError
from lcbayes.core.progress import Console, Notebook, Parts, Silent, reporter


class Noted:
    def __init__(self) -> None:
        self.done, self.notes = 0, []

    def advance(self, n: int, note: str = "") -> None:
        assert n >= 0
        self.done += n
        self.notes.append(note)

    def more(self, n: int) -> None:
        raise AssertionError(f"{n} more: the whole is the parts' own")


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


def test_what_goes_on_says_how_much_is_left(capsys, monkeypatch):
    """Where nobody looks on: a line at once, when all that was announced is done, and when the rest
    is."""
    monkeypatch.setattr("sys.stderr.isatty", lambda: False)
    with Console().stage("sampling", 100, "draws") as track:
        track.advance(100)
        track.more(100)
        track.advance(50)  # within ten seconds: no line
        track.advance(50, "done")
    lines = capsys.readouterr().err.splitlines()
    assert [line.split(",")[0] for line in lines] == [
        "sampling: 100 draws",
        "sampling: 100/100 draws",
        "sampling: 200/200 draws",
    ]
    assert lines[-1].endswith("; done")


def test_the_rate_is_of_what_follows_the_first(capsys, monkeypatch):
    """A minute of compiling before it had made "10389 s left" of one minute."""
    clock = iter([0.0, 60.0, 70.0, 80.0])
    monkeypatch.setattr("sys.stderr.isatty", lambda: False)
    monkeypatch.setattr("time.monotonic", lambda: next(clock))
    with Console().stage("searching", 100, "steps") as track:
        for _ in range(3):
            track.advance(10)
    assert capsys.readouterr().err.splitlines() == [
        "searching: 100 steps",
        "searching: 10/100 steps",
        "searching: 20/100 steps, 1/s, 80 s left",
        "searching: 30/100 steps, 1/s, 70 s left",
    ]


def test_a_bar_on_a_terminal_has_a_rate_and_grows(monkeypatch):
    """The last state of the bar: done of the new total, and the note."""
    monkeypatch.setattr(sys, "stderr", Terminal())
    with Console().stage("sampling", 10, "draws") as bar:
        bar.advance(4, "0 divergent")
        bar.more(2)
        bar.advance(8, "1 divergent")
    shown = sys.stderr.getvalue()  # pyright: ignore[reportAttributeAccessIssue]
    assert "sampling" in shown
    last = shown[shown.rindex("12/12") :]
    assert "draws, " in last
    assert "1 divergent" in last


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


class Cell:
    """What a notebook shows: the module IPython.display, and the texts in the order of showing."""

    def __init__(self) -> None:
        self.shown: list[str] = []

    def HTML(self, text: str) -> str:
        return text

    def display(self, text: str, display_id: bool) -> Cell:
        assert display_id
        self.shown.append(text)
        return self

    def update(self, text: str) -> None:
        self.shown.append(text)


@pytest.fixture
def notebook(monkeypatch):
    cell = Cell()
    shell = SimpleNamespace(config={"IPKernelApp": {}})
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: shell))
    monkeypatch.setitem(sys.modules, "IPython.display", cell)
    return cell


def test_a_notebook_shows_a_bar_and_removes_it(notebook, monkeypatch):
    now = iter(np.arange(0.0, 100.0, 0.5))
    monkeypatch.setattr("time.monotonic", lambda: float(next(now)))
    with reporter().stage("searching <x>", 4, "starts") as track:
        for _ in range(4):
            track.advance(1)
    assert (
        '<progress value="2" max="4"></progress> searching &lt;x&gt;: 2/4 starts'
        in notebook.shown[3]
    )
    assert 'value="4"' in notebook.shown[-2]
    assert notebook.shown[-1] == ""
    assert type(reporter(progress=False)) is Silent
    assert isinstance(reporter(progress=True), Notebook)


def test_elsewhere_there_is_no_bar_unless_it_is_asked_for():
    assert type(reporter()) is type(reporter(progress=False)) is Silent
    console = reporter(progress=True)
    assert isinstance(console, Console)
    assert reporter(console) is console
    with pytest.raises(InputError, match="progress is 3; give True, False or a Console"):
        reporter(3)
