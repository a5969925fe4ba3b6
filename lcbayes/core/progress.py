"""Progress: a bar on a terminal or under the cell of a notebook, otherwise occasional lines."""

from __future__ import annotations

import html
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any, Protocol

from lcbayes.core.errors import InputError


class Track(Protocol):
    """Interface through which a running stage reports its progress."""

    def advance(self, n: int, note: str = "") -> None: ...

    def more(self, n: int) -> None:
        """Increase the expected total by n."""
        ...


class Silent:
    """No progress at all: the default in Python, except in a notebook."""

    def say(self, text: str) -> None:
        pass

    @contextmanager
    def stage(self, title: str, total: int, unit: str) -> Iterator[Track]:  # noqa: ARG002
        yield _Nothing()


class _Nothing:
    def advance(self, n: int, note: str = "") -> None:
        pass

    def more(self, n: int) -> None:
        pass


class Console(Silent):
    """A bar with rate and remaining time on a terminal; otherwise one line per 10 s at most."""

    def say(self, text: str) -> None:
        print(text, file=sys.stderr, flush=True)

    @contextmanager
    def stage(self, title: str, total: int, unit: str) -> Iterator[Track]:
        if not sys.stderr.isatty():
            yield _Lines(title, total, unit)
            return
        from rich.console import Console as RichConsole
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
        from rich.progress import TimeRemainingColumn as Remaining

        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn(f"{unit}, {{task.fields[rate]}}"),
            Remaining(),
            TextColumn("{task.fields[note]}"),
        )
        with Progress(*columns, console=RichConsole(stderr=True)) as bars:
            task = bars.add_task(title, total=total, note="", rate="?")
            started = time.monotonic()
            done = 0

            class Bar:
                def advance(self, n: int, note: str = "") -> None:
                    nonlocal done
                    done += n
                    rate = done / max(time.monotonic() - started, 1e-9)
                    bars.update(task, advance=n, note=note, rate=_rate(rate))

                def more(self, n: int) -> None:
                    bars.update(task, total=(bars.tasks[task].total or 0) + n)

            yield Bar()


def _rate(per_second: float) -> str:
    """A rate per second, or per hour if it is small."""
    return f"{per_second:.3g}/s" if per_second >= 1.0 else f"{3600.0 * per_second:.0f}/h"


def _time(seconds: float) -> str:
    """A duration in s, or in h if it is long."""
    return f"{seconds:.0f} s" if seconds < 7200.0 else f"{seconds / 3600.0:.1f} h"


class Notebook(Silent):
    """A bar under the cell of a notebook while a stage runs."""

    @contextmanager
    def stage(self, title: str, total: int, unit: str) -> Iterator[Track]:
        bar = _Cell(title, total, unit)
        try:
            yield bar
        finally:
            bar.close()


def in_notebook() -> bool:
    """Whether this process is the kernel of a notebook."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return "IPKernelApp" in getattr(shell, "config", {})


def reporter(progress: Any = None) -> Silent:
    """What reports the progress of a task.

    Parameters
    ----------
    progress : Silent, bool or None
        True for bars or lines, False for none, None for bars in a notebook and nothing elsewhere.

    Raises
    ------
    InputError
        It is something else.

    Examples
    --------
    >>> type(reporter(True)).__name__
    'Console'
    """
    if isinstance(progress, Silent):
        return progress
    if progress is None or isinstance(progress, bool):
        if progress is not False and in_notebook():
            return Notebook()
        return Console() if progress else Silent()
    raise InputError(f"progress is {progress!r}; give True, False or a Console of lcbayes")


class _Lines:
    every_s = 10.0

    def __init__(self, title: str, total: int, unit: str) -> None:
        self.title, self.total, self.unit = title, total, unit
        self.done, self.said = 0, time.monotonic()
        self.begun: float | None = None
        self.show(f"{title}: {total} {unit}")

    def show(self, text: str) -> None:
        print(text, file=sys.stderr, flush=True)

    def advance(self, n: int, note: str = "") -> None:
        now = time.monotonic()
        if self.begun is None:  # the time before is mostly compilation, not counted in the rate
            self.begun, self.first = now, n
        self.done += n
        if now - self.said < self.every_s and self.done < self.total:
            return
        self.said = now
        said = f"{self.title}: {self.done}/{self.total} {self.unit}"
        if self.done > self.first and now > self.begun:
            rate = (self.done - self.first) / (now - self.begun)
            said += f", {_rate(rate)}, {_time((self.total - self.done) / rate)} left"
        self.show(f"{said}; {note}" if note else said)

    def more(self, n: int) -> None:
        self.total += n


class _Cell(_Lines):
    """The same under the cell of a notebook, where it is replaced in place."""

    every_s = 0.3

    def __init__(self, title: str, total: int, unit: str) -> None:
        self.shown = import_module("IPython.display")
        self.handle = self.shown.display(self.shown.HTML(""), display_id=True)
        super().__init__(title, total, unit)

    def show(self, text: str) -> None:
        bar = f'<progress value="{self.done}" max="{self.total}"></progress>'
        self.handle.update(self.shown.HTML(f"{bar} {html.escape(text)}"))

    def close(self) -> None:
        self.handle.update(self.shown.HTML(""))


class Parts:
    """Stages of different cost, shown as a single stage of ``units`` units."""

    def __init__(self, track: Track, units: int, total: float) -> None:
        self.track, self.units, self.total = track, units, total
        self.done, self.reported = 0.0, 0

    @contextmanager
    def part(self, cost: float, name: str, n_stages: int) -> Iterator[Silent]:
        """A part with the share ``cost`` of the total and up to ``n_stages`` equal stages."""
        begun = self.done
        try:
            yield _Part(self, cost / n_stages, name)
        finally:
            self.reach(begun + cost, name)

    def reach(self, done: float, note: str) -> None:
        self.done = done
        whole = max(self.reported, int(self.units * done / self.total + 1e-9))  # the total may grow
        self.track.advance(whole - self.reported, note)
        self.reported = whole


class _Part(Silent):
    def __init__(self, parts: Parts, cost: float, name: str) -> None:
        self.parts, self.cost, self.name = parts, cost, name

    @contextmanager
    def stage(self, title: str, total: int, unit: str) -> Iterator[Track]:  # noqa: ARG002
        yield _Share(self, total)


class _Share:
    def __init__(self, part: _Part, total: int) -> None:
        self.part, self.total = part, total

    def advance(self, n: int, note: str = "") -> None:
        part = self.part
        said = f"{part.name}, {note}" if note else part.name
        part.parts.reach(part.parts.done + part.cost * n / self.total, said)

    def more(self, n: int) -> None:
        self.total += n
