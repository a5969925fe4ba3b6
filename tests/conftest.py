"""One browser for all tests of pages, where real observations lie, how XLA optimises, which tests
are long, and how often tests may fail by chance."""

from __future__ import annotations

import gc
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.helpers import browser_pages, false_alarms, file_groups, quick_run

MOST_MAPS = 20_000


@pytest.hookimpl(tryfirst=True)  # before any are deselected
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    config.stash[false_alarms.COLLECTED] = false_alarms.check(items)
    quick_run.mark(items)


@pytest.hookimpl(optionalhook=True)  # of pytest-xdist
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> object | None:
    if config.getvalue("dist") != "loadfile":
        return None
    from xdist.scheduler import LoadFileScheduling

    class Scheduling(LoadFileScheduling):
        """A group of files goes to one worker, as does any other file."""

        def _split_scope(self, nodeid: str) -> str:
            return file_groups.group(super()._split_scope(nodeid))

    return Scheduling(config, log)


def pytest_collection_finish() -> None:
    """Leave the imported modules, a million objects, out of each garbage collection."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000, 20, 50)


@pytest.fixture(scope="module", autouse=True)
def _few_programs() -> Iterator[None]:
    """Forget compiled programs after a file if they are many.

    Each has up to a thousand memory maps. Linux allows a process 65,530, and JAX ends it with a
    segmentation fault when there are no more.
    """
    yield
    maps = Path("/proc/self/maps")
    if maps.is_file() and maps.read_bytes().count(b"\n") > MOST_MAPS:
        from lcbayes.inference import problem_cache

        problem_cache.forget()


@pytest.fixture(scope="module")
def full_optimisation() -> Iterator[None]:
    """Programs as a user's also in the quick run: for modules that run theirs for longer than XLA
    takes to optimise them."""
    yield from _less_optimised(False)


@pytest.fixture
def quick_compilation() -> Iterator[None]:
    """Programs as in the quick run also with `make test-all`, for tests that mostly compile."""
    yield from _less_optimised(True)


def _less_optimised(wanted: bool) -> Iterator[None]:
    from lcbayes.core.jax_setup import jax

    before = jax.config.read("jax_disable_most_optimizations")
    jax.config.update("jax_disable_most_optimizations", wanted)
    yield
    jax.config.update("jax_disable_most_optimizations", before)


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """Real observations: `$LCBAYES_DATA`, else `../shared/data` beside the project."""
    given = os.environ.get("LCBAYES_DATA")
    folder = Path(given) if given else Path(__file__).parents[2] / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"no real observations at {folder}; set LCBAYES_DATA")
    return folder


@pytest.fixture(scope="session")
def _chromium() -> Iterator[object | None]:
    if browser_pages.executable() is None or not browser_pages.has_driver():
        yield None
        return
    with browser_pages.chromium() as browser:
        yield browser


@pytest.fixture(scope="session")  # before the fixtures of a module make its pages
def browser(_chromium) -> object:
    """Chromium; the test is skipped where there is none."""
    if _chromium is None:
        pytest.skip(f"needs playwright and one of {', '.join(browser_pages.NAMES)} on the path")
    return _chromium


@pytest.fixture
def look(_chromium) -> Callable[..., None]:
    """Assert that a page is right in a browser; where there is none, only its text was tested."""

    def check(page: Path, turning: int = 0) -> None:
        if _chromium is None:
            return
        seen = browser_pages.look(_chromium, page)
        assert seen.faults == []
        assert len(seen.views) == turning
        for start, dragged, turned, back in seen.views:
            assert len({start, dragged, turned}) == 3
            assert back == start

    return check
