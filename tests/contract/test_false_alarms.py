"""How often the tests may fail by chance: every rate is declared, and their sum is small."""

from __future__ import annotations

import ast
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from tests.helpers import false_alarms

TESTS = Path(__file__).parents[1]
# What tests with a threshold on random draws say, or call.
TELLING = re.compile(
    r"false alarm|(?<!on )standard errors?\b|binomial|kstest\(|chisquare\(|binomtest\(|"
    r"(?<![\w.])(limit|counts|squares)\("
)


def statistical(function: ast.FunctionDef) -> bool:
    return any("mark.statistical" in ast.unparse(d) for d in function.decorator_list)


def functions_of(path: Path) -> list[tuple[ast.FunctionDef, str]]:
    """Tests of a file, each with its source, comments too."""
    text = path.read_text(encoding="utf-8")
    return [
        (node, ast.get_source_segment(text, node) or "")
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.FunctionDef) and node.name.startswith("test_")
    ]


def test_all_tests_together_fail_by_chance_once_in_a_thousand_runs(request):
    """Of those collected here; pytest ends with an error before it comes so far."""
    declared = request.config.stash[false_alarms.COLLECTED]
    assert declared < false_alarms.MOST
    some = any(item.get_closest_marker("statistical") for item in request.session.items)
    assert declared > 0.0 or not some  # those deselected were collected too


def test_tests_that_speak_of_chance_declare_its_rate():
    silent, marked = [], 0
    for path in sorted(TESTS.rglob("test_*.py")):
        if path == Path(__file__):
            continue
        for function, source in functions_of(path):
            marked += statistical(function)
            if TELLING.search(source) and not statistical(function):
                silent.append(f"{path.relative_to(TESTS)}: {function.name}")
    assert silent == []
    assert marked > 50


def item(name: str, **given: Any) -> Any:
    mark = SimpleNamespace(args=(), kwargs=given) if given else None
    return SimpleNamespace(nodeid=name, get_closest_marker=lambda _: mark)


def test_rates_are_summed_and_too_much_is_refused():
    few = [item("a", false_alarm=1e-5), item("b"), item("c", false_alarm=2e-5)]
    assert false_alarms.check(few) == pytest.approx(3e-5)
    with pytest.raises(pytest.UsageError, match=r"in 1\.1e-03 of all runs"):
        false_alarms.check(11 * [item("a", false_alarm=1e-4)])
    for wrong in (0.0, 0.05, "rarely"):
        with pytest.raises(pytest.UsageError, match="give a probability"):
            false_alarms.check([item("a", false_alarm=wrong)])


@pytest.mark.parametrize(("k", "dof"), [(1, np.inf), (6, 23)])
def test_limits_keep_the_rate(k, dof):
    """Of all k comparisons together, two-sided; and counts and squares on either side."""
    most = false_alarms.limit(k, dof)
    assert 2 * k * stats.t.sf(most, dof) == pytest.approx(false_alarms.EACH, rel=1e-9)
    low, high = false_alarms.counts(400, 0.9, k)
    outside = stats.binom.cdf(low - 1, 400, 0.9) + stats.binom.sf(high, 400, 0.9)
    assert 0.1 * false_alarms.EACH < k * outside <= false_alarms.EACH
    low, high = false_alarms.squares(60, k)
    outside = stats.chi2.cdf(low, 60) + stats.chi2.sf(high, 60)
    assert k * outside == pytest.approx(false_alarms.EACH, rel=1e-6)
