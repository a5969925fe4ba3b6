"""Every reason code has one sentence, and every sentence has a code that occurs."""

from __future__ import annotations

import ast
import string
from pathlib import Path

import pytest

from lcbayes.core.reasons import Finding
from lcbayes.inference.goodness_of_fit import Misfit
from lcbayes.inference.misfit_tests import Examination, Explanation, ResidualTest
from lcbayes.inversion.spin import sidereal
from lcbayes.results.reasons import (
    CAUSES,
    CONDITIONS,
    SENTENCES,
    TESTS,
    condition,
    name_of_test,
    reason,
    reasons,
    why,
)

ROOT = Path(__file__).resolve().parents[3] / "lcbayes"


def _texts(top: str) -> set[str]:
    """All string constants of a package."""
    return {
        node.value
        for path in (ROOT / top).rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    }


def _codes() -> set[str]:
    """The codes of all findings in the source."""
    codes = set()
    for path in ROOT.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and ast.unparse(node.func).endswith("Finding"):
                first = node.args[0]
                if isinstance(first, ast.Constant):
                    codes.add(first.value)
    return codes


def test_every_code_has_a_sentence():
    assert len(_codes()) > 30
    assert _codes() <= set(SENTENCES)


def test_every_sentence_is_used():
    used = set().union(*map(_texts, ("samplers", "inference", "inversion", "tasks")))
    used |= {t for t in _codes() if t in SENTENCES}
    assert set(SENTENCES) <= used


def test_sentences_of_conditions_use_the_values_of_their_reasons():
    """A condition is met or not with the same finding."""

    def fields(template: str) -> set[str]:
        return {name for _, name, *_ in string.Formatter().parse(template) if name}

    for code, words in CONDITIONS.items():
        assert fields(words) <= fields(SENTENCES[code])


def test_conditions_of_a_spin():
    spin = sidereal.Spin([], sidereal.np.zeros(1), sidereal.np.zeros(1), 0.5)
    assert not spin.require("rapid", False, "too-few-passes", count=2, least=3)
    assert spin.require("unique", True, "many-poles", count=1, most=4)
    assert [finding.code for finding in spin.reasons] == ["too-few-passes"]
    rapid, one = spin.conditions
    assert condition(rapid.finding, met=rapid.met).startswith(
        "2 pass(es) show steady harmonics, and 3"
    )
    assert condition(one.finding, met=one.met) == "1 pole(s)"


@pytest.mark.parametrize(
    ("remedy", "words"), [("", "light curve"), ("another-law", "fit takes by default)")]
)
def test_a_remedy_is_added_where_there_is_one(remedy, words):
    values = {"percent": 12.3, "materials": "lambertian", "remedy": remedy}
    text = reason(Finding("large-residuals", values)).text
    assert text.startswith("residuals are 12 % of the mean flux: no convex body")
    assert text.endswith(words)


def test_reasons_are_named_once_with_the_part_concerned():
    finding = Finding("no-glint", {"alarm": 0.01}, about="pass 2")
    (one,) = reasons([finding, finding])
    assert str(one) == (
        "pass 2: no glint stands out: none has a false-alarm probability below 0.01"
    )


def test_a_reason_that_concerns_several_solutions_is_given_once():
    result = [
        Finding("chains-disagree", {"rhat": rhat, "limit": 1.01}, f"solution {i}")
        for i, rhat in ((1, 1.2), (2, 1.3), (4, 1.4))
    ]
    sizes = [
        Finding(
            "few-effective-draws",
            {"ess": 90.0, "kind": kind, "limit": 400, "taken": 750},
            "solution 2",
        )
        for kind in ("bulk", "tail")
    ]
    one, bulk, tail = reasons([result[0], sizes[0], *result[1:], sizes[1]])
    assert one.text.startswith("solution 1: the chains disagree (R-hat 1.200")
    assert one.text.endswith("; likewise solutions 2 and 4")
    assert "take more than 750 in a chain with --num-samples" in bulk.text
    assert ("(bulk" in bulk.text, "(tail" in tail.text) == (True, True)
    (pair,) = reasons(result[:2])
    assert pair.text.endswith("; likewise solution 2")


@pytest.mark.parametrize(
    ("gain", "even", "says"),
    [
        (43.0, True, "the errors are 3.2 times too small, since the residuals are white"),
        (43.0, False, "no single change of the model removes half of the excess of chi2; try more"),
        (700.0, False, "a further facet"),
    ],
)
def test_errors_are_named_where_no_change_of_the_model_explains_most(gain, even, says):
    facet = Explanation("facet", "", "m2", "phi 0.1", 0.05, 0.01, gain, 1e-4)
    tests = [ResidualTest("chi2", 1045.0, 1e-4)]
    misfit = Misfit(
        1045.0, 101.8, "gaussian", examination=Examination(tests, [facet], 0.01, even=even)
    )
    assert says in why(misfit)
    assert "more facets" not in why(misfit._replace(facets=False))


def test_heavy_tails_are_named_before_errors_that_are_too_small():
    tests = [ResidualTest("chi2", 1045.0, 1e-4)]
    outliers = Examination(tests, [], 0.01, kurtosis=17.2)
    says = why(Misfit(1045.0, 101.8, "gaussian", examination=outliers))
    assert "outliers" in says
    assert "(kurtosis 17.2 instead of 3): try --noise student-t" in says
    assert "times too small" not in says
    assert "outliers" not in why(Misfit(1045.0, 101.8, "student-t", examination=outliers))


def test_an_amount_beyond_the_linear_range_is_no_sure_cause():
    nutation = Explanation("nutation", "", "deg", "0.3 times the rate", 9.4, 0.1, 900.0, 1e-4)
    tests = [ResidualTest("chi2", 1045.0, 1e-4)]
    sure, rough = (
        why(Misfit(1045.0, 101.8, "gaussian", examination=Examination(tests, [one], 0.01)))
        for one in (nutation, nutation._replace(rough=True))
    )
    assert "a possible explanation: the body nutates by 9.4" in sure
    assert "a rough guess, because the amount is too large" in rough


def test_every_test_of_the_residuals_has_words():
    assert set(CAUSES) <= set(TESTS)
    assert name_of_test("lobe facet 1") == "a weak lobe of facet 1"
    assert name_of_test("zero-point site Calar Alto") == "the zero point of site Calar Alto"
    assert name_of_test("rotational phase") == "the residuals against the rotational phase"
