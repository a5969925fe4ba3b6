"""The tests that `make test` leaves to `make test-more`, since others execute most of their lines.

    python -m tests.helpers.quick_run COVERAGE_FILE JUNIT_FILE

Both files are of one run, with nothing else on the machine and no program compiled before:

    LCBAYES_CACHE=EMPTY_FOLDER python -m pytest -m "not slow and not medium" --cov \
        --cov-context=test --junitxml=JUNIT_FILE

From the longest to the shortest, a test is listed in ``medium_tests.txt`` if it takes more than
`SECONDS_PER_LINE` for each line of the package that no test outside the list executes. The quick
run therefore covers nearly the same lines. The tests that are listed already do not take part in
the run and stay listed; empty the list to start again. Tests that share a long fixture, and others
of more than two seconds, have been added by hand until the quick run took six minutes. The tests of
``long_tests.txt`` are left to `make test-all`.
"""

from __future__ import annotations

import sys
import xml.etree.ElementTree as ET
from collections import Counter
from pathlib import Path

import pytest
from coverage import CoverageData

TESTS = Path(__file__).parents[1]
LISTS = {"slow": TESTS / "long_tests.txt", "medium": TESTS / "medium_tests.txt"}  # by mark
LEAST_S = 1.0  # shorter tests are not worth an entry
SECONDS_PER_LINE = 0.2
# What these test is no line of the package: what is installed, and what imports what.
KEPT = ("tests/e2e/test_packaging.py", "tests/contract/test_imports.py")


def listed(mark: str) -> set[str]:
    """Node ids in the list of a mark of `LISTS`."""
    return {line for line in LISTS[mark].read_text().splitlines() if line and line[0] != "#"}


def mark(items: list[pytest.Item]) -> None:
    """Mark the listed tests."""
    names = {one: listed(one) for one in LISTS}
    for item in items:
        for one in LISTS:
            if item.nodeid in names[one]:
                item.add_marker(one)


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
        if alone * SECONDS_PER_LINE <= times[name]:
            left.subtract(own)
            long.append(name)
    return long


if __name__ == "__main__":
    data = CoverageData(sys.argv[1])
    data.read()
    head = f"# Chosen by {Path(__file__).name}, which says how.\n"
    names = listed("medium").union(chosen(seconds(Path(sys.argv[2])), lines(data)))
    LISTS["medium"].write_text(head + "".join(f"{name}\n" for name in sorted(names)))
