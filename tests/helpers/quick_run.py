"""The tests that `make test` leaves to `make test-all` because others execute their lines.

    python -m tests.helpers.quick_run COVERAGE_FILE JUNIT_FILE

Both files are of one run:

    python -m pytest -m "not slow" --cov --cov-context=test --junitxml=JUNIT_FILE

From the longest to the shortest, a test is listed if every line of the package that it executes is
executed by a test that is not listed. The quick run therefore covers the same lines. A long test is
also listed if it takes more than `SECONDS_PER_LINE` for each line that no other test executes. The
tests that are listed already do not take part in the run and stay listed; empty the list to start
again.
"""

from __future__ import annotations

import sys
import xml.etree.ElementTree as ET
from collections import Counter
from pathlib import Path

import pytest
from coverage import CoverageData

LIST = Path(__file__).parents[1] / "long_tests.txt"
LEAST_S = 0.3  # shorter tests are not worth an entry
LONG_S, SECONDS_PER_LINE = 2.0, 0.7
# What these test is no line of the package: what is installed, and what imports what.
KEPT = ("tests/e2e/test_packaging.py", "tests/contract/test_imports.py")


def listed() -> set[str]:
    """Node ids in ``long_tests.txt``."""
    return {line for line in LIST.read_text().splitlines() if line and line[0] != "#"}


def mark(items: list[pytest.Item]) -> None:
    """Mark the listed tests as slow."""
    long = listed()
    for item in items:
        if item.nodeid in long:
            item.add_marker(pytest.mark.slow)


def seconds(junit: Path) -> dict[str, float]:
    """Time of each test by node id."""
    times = {}
    for case in ET.parse(junit).iter("testcase"):
        parts = case.attrib["classname"].split(".")
        files = (i for i, part in enumerate(parts, 1) if part.startswith("test_"))
        depth = next(files, len(parts))
        where = ["/".join(parts[:depth]) + ".py", *parts[depth:], case.attrib["name"]]
        times["::".join(where)] = float(case.attrib["time"])
    return times


def lines(data: CoverageData) -> dict[str, set[tuple[str, int]]]:
    """Lines of the package by the node id of the test that executes them."""
    result: dict[str, set[tuple[str, int]]] = {}
    for path in data.measured_files():
        for number, contexts in data.contexts_by_lineno(path).items():
            for context in contexts:
                result.setdefault(context.partition("|")[0], set()).add((path, number))
    return result


def chosen(times: dict[str, float], executed: dict[str, set[tuple[str, int]]]) -> list[str]:
    """Node ids of tests that the quick run can do without, the longest first."""
    imported = executed.get("", set())
    left = Counter(line for name, some in executed.items() if name for line in some - imported)
    long = []
    for name in sorted(times, key=lambda n: (-times[n], n)):
        if times[name] < LEAST_S or name.startswith(KEPT) or name not in executed:
            continue
        own = executed[name] - imported
        alone = sum(left[line] == 1 for line in own)
        if alone * SECONDS_PER_LINE <= (times[name] if times[name] >= LONG_S else 0.0):
            left.subtract(own)
            long.append(name)
    return long


if __name__ == "__main__":
    data = CoverageData(sys.argv[1])
    data.read()
    head = f"# Chosen by {Path(__file__).name}, which says how.\n"
    names = listed().union(chosen(seconds(Path(sys.argv[2])), lines(data)))
    LIST.write_text(head + "".join(f"{name}\n" for name in sorted(names)))
