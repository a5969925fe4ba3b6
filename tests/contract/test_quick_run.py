"""What leaves the quick run executes few lines that the rest does not, and is still a test."""

from __future__ import annotations

from pathlib import Path

from tests.helpers import quick_run

ROOT = Path(__file__).parents[2]


def test_the_longest_of_equal_tests_leaves():
    lines = {
        name: {("file", 10 * n + k) for n in numbers for k in range(10)}
        for name, numbers in CASES.items()
    }
    # Tens of lines: "a" has 3 alone; "b" is in "c" and "d"; without it, "c" has 2 alone.
    times = {"a": 1.9, "b": 1.5, "c": 1.4, "d": 1.3, "e": 0.2}
    assert quick_run.chosen(times, lines) == ["b", "d"]
    assert quick_run.chosen({"unknown": 9.0}, lines) == []


def test_a_long_test_leaves_for_few_lines():
    lines = {"a": {("file", n) for n in range(20)}, "b": {("file", n) for n in range(6)}}
    assert quick_run.chosen({"a": 2.7, "b": 0.1}, lines) == []  # fourteen lines of its own
    assert quick_run.chosen({"a": 2.9, "b": 0.1}, lines) == ["a"]


CASES = {"": [0], "a": [0, 3], "b": [1, 2], "c": [0, 1, 2], "d": [1], "e": [1]}


def test_times_have_the_names_of_tests(tmp_path):
    cases = '<testcase classname="tests.unit.test_a.TestB" name="test_c[1]" time="2.5"/>'
    cases += '<testcase classname="tests.e2e.test_d" name="test_e" time="0.5"/>'
    (tmp_path / "times.xml").write_text(f"<testsuite>{cases}</testsuite>")
    assert quick_run.seconds(tmp_path / "times.xml") == {
        "tests/unit/test_a.py::TestB::test_c[1]": 2.5,
        "tests/e2e/test_d.py::test_e": 0.5,
    }


def test_every_listed_test_is_there():
    for name in quick_run.listed("slow") | quick_run.listed("medium"):
        path, _, function = name.partition("::")
        function = function.partition("[")[0].rpartition("::")[2]
        assert f"def {function}(" in (ROOT / path).read_text(), name
