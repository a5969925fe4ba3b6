"""A comparison in words, of candidates whose numbers are known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import norm

from lcbayes.analysis import comparison_page
from lcbayes.core.reasons import Finding
from lcbayes.inference.area_prior import AreaPrior
from lcbayes.inference.facet_count import Candidate, Compared
from lcbayes.inference.goodness_of_fit import Misfit
from lcbayes.inference.loo import Loo
from lcbayes.inference.screening import RuledOut
from lcbayes.inference.sparse import SparsePath
from lcbayes.results import comparison
from lcbayes.tasks.compare.options import CompareOptions
from lcbayes.tasks.compare.result import Comparison
from lcbayes.tasks.load import load
from tests.helpers import browser_pages

T = 40
UNKNOWN = Misfit(None, 28.4, "gaussian")  # errors
IDENTITY = {"model": "faceted"}
RUN = {
    "task": "compare",
    "curve": "/far/pass.csv",
    "version": "1",
    "options": {
        "spin": "none",
        "n_facets": [2, 3, 4],
        "model": "faceted",
        "seed": 3,
        "num_particles": 50,
        "num_runs": 4,
        "num_starts": 0,
        "sparse": 6,
        "omega_sd": "0.1",
    },
    "reading": {"error_floor": 0.01},
}


def candidate(n: int, log_z: float, **changes) -> Candidate:
    rng = np.random.default_rng(n)
    elpd = rng.normal(1.0 + 0.01 * log_z, 0.5, T)
    return replace(
        Candidate(
            n_facets=n,
            n_parameters=3 * n + 3,
            log_evidences=log_z + np.array([-0.1, 0.1, 0.0, 0.0]),
            log_evidence=log_z,
            se=0.05,
            log_prior_mass=-0.3,
            loo=Loo(elpd, np.full(T, 0.2)),
            misfit=Misfit(40.0, T - 3 * n - 3.0, "gaussian"),
            information=1.0,
            best=50.0 + n,
            z_best=np.zeros(4 * n + 3),
            gradients=1000,
            seconds=2.0,
        ),
        **changes,
    )


def compared(*candidates: Candidate, **changes) -> Compared:
    return replace(Compared(list(candidates), [], [], 1.0, 3, None, 1.5), **changes)


def summary(*candidates: Candidate, n_obs: int = T, **changes) -> dict:
    content, against = comparison.summarise(compared(*candidates, **changes), IDENTITY, n_obs, 0)
    return content | {"trusted": not against, "reasons": [reason.text for reason in against]}


def result(*candidates: Candidate, **changes) -> Comparison:
    content, against = comparison.summarise(compared(*candidates, **changes), IDENTITY, T, 0)
    return Comparison(content, against, RUN)


def lost(text: str) -> Finding:
    return Finding("number-not-followed", {"why": text})


THREE = (candidate(2, -8.0), candidate(3, 1.0), candidate(4, -2.0))


def test_numbers_and_conclusion():
    summary_content = summary(*THREE)
    p = np.exp([-8.0, 1.0, -2.0]) / np.exp([-8.0, 1.0, -2.0]).sum()
    rows = summary_content["candidates"]
    np.testing.assert_allclose([r["probability"] for r in rows], p)
    assert summary_content["conclusion"].startswith("3 facets are most probable (0.95); 4 (0.05)")
    assert (
        summary_content["trusted"],
        summary_content["reasons"],
        summary_content["most_probable"],
    ) == (True, [], 3)
    assert rows[0]["log_evidence_spread"] == pytest.approx(np.std([-0.1, 0.1, 0, 0], ddof=1))
    elpd = THREE[0].loo.elpd
    assert rows[0]["elpd_loo"] == pytest.approx(elpd.sum())
    assert rows[0]["elpd_se"] == pytest.approx(np.sqrt(T * elpd.var()))
    assert sum(r["stacking_weight"] for r in rows) == pytest.approx(1.0, abs=1e-6)
    assert set(comparison.COLUMNS) - set(rows[0]) == {"body", "log_evidence_below"}


def test_points_that_follow_each_other_widen_the_errors_of_loo():
    alone, together = summary(*THREE), summary(*THREE, information=0.25)
    for a, b in zip(alone["candidates"], together["candidates"], strict=True):
        assert b["elpd_loo"] == a["elpd_loo"]
        assert b["elpd_se"] == pytest.approx(2 * a["elpd_se"])
        assert b["elpd_diff_se"] == pytest.approx(2 * a["elpd_diff_se"])
    (note,) = comparison.notes(together)
    assert "the 40 points count as 10, for every number" in note


def test_reasons():
    stuck = Finding("particles-moved-little", {"progress": 0.5, "moved": 0.1, "moves": 40})
    poor = candidate(3, 1.0, reasons=[stuck])
    far = candidate(2, -60.0, reasons=[stuck])
    assert summary(far, *THREE[1:])["reasons"] == []  # 60 nats away whatever it did
    assert summary(THREE[0], poor)["reasons"] == [
        "3 facets: 50% of the way to the posterior the particles moved 10% of what independent "
        "ones would in 40 moves"
    ]
    assert summary(*THREE, failed=[lost("5 facets: lost")])["reasons"] == ["5 facets: lost"]
    assert result(THREE[0], poor).reasons[0].code == "particles-moved-little"
    wide = summary(candidate(2, 0.0, se=1.0), candidate(3, 0.2, se=1.0))
    assert ["independent runs differ" in r for r in wide["reasons"]] == [True]
    assert not wide["trusted"]


def test_a_poor_fit_is_reported():
    poor = Misfit(200.0, 28.4, "gaussian")
    (reason,) = summary(THREE[0], candidate(3, 1.0, misfit=poor))["reasons"]
    assert reason.startswith("3 facets do not explain the data, and no other number")
    assert "chi2 is 200 for 28.4 degrees" in reason
    assert summary(candidate(2, -9.0, misfit=poor), *THREE[1:])["reasons"] == []
    assert summary(*(replace(c, misfit=UNKNOWN) for c in THREE))["reasons"] == []


def test_residuals_cleaner_than_the_search_found_are_reported():
    clean = candidate(4, -2.0, information=0.9)
    assert summary(*THREE[:2], clean, information=0.7)["reasons"] == []
    (reason,) = summary(*THREE[:2], clean, information=0.5)["reasons"]
    assert "counted as 0.5 " in reason
    assert "worth 0.9" in reason
    assert "--num-starts" in reason


def test_a_path_that_went_astray_does_not_decide():
    """The best particle of four facets has 54; half of it where points count half."""
    path = SparsePath(6, 0.1, {6: 1.0}, 6, 45.0)
    assert not summary(*THREE, path=path)["sparse"]["astray"]
    summary_content = summary(*THREE, path=replace(path, best=14.0))
    assert (summary_content["trusted"], summary_content["reasons"]) == (True, [])
    assert any(
        "40 nats worse than the best number" in line for line in comparison.notes(summary_content)
    )
    half = [replace(c, information=0.5) for c in THREE]
    assert not summary(*half, path=replace(path, best=20.0), information=0.5)["sparse"]["astray"]
    none = summary(*THREE, path_fault="no start")
    assert none["trusted"]
    assert "There is no sparse path: no start." in comparison.notes(none)[0]


def test_the_odds_under_other_priors_on_areas():
    """Draws without scatter: the ratio of two log-normal densities at their areas, exactly."""
    prior = AreaPrior(np.log(4.0), 1.0, 0.0, True)
    at = [np.log([[4.0, 4.0]] * 150), np.log([[4.0, 4.0, 0.1]] * 150)]
    pair = [replace(candidate(n, 0.0), log_areas=x) for n, x in zip((2, 3), at, strict=True)]
    summary_content = summary(*pair, area_prior=prior)
    scan = {
        round(row["median_m2"], 3): row["probability"]
        for row in summary_content["area_prior"]["scan"]
    }
    assert list(scan) == [0.8, 1.0, 2.0, 4.0, 8.0, 20.0]
    np.testing.assert_allclose(scan[4.0], [0.5, 0.5])
    density = [
        float(norm.logpdf(x[0], np.log(8.0)).sum() - norm.logpdf(x[0], np.log(4.0)).sum())
        for x in at
    ]
    want = np.exp(density) / np.exp(density).sum()
    np.testing.assert_allclose(scan[8.0], want)
    (note,) = comparison.notes(summary_content)
    assert "has the median 4 m², that of the best fit" in note
    assert f"8 m² (2: {want[0]:.2f}, 3: {want[1]:.2f})" in note
    rng = np.random.default_rng(0)
    wide = [
        replace(c, log_areas=c.log_areas + 5 * rng.normal(size=c.log_areas.shape)) for c in pair
    ]
    medians = [row["median_m2"] for row in summary(*wide, area_prior=prior)["area_prior"]["scan"]]
    assert medians == [pytest.approx(4.0)]  # too few effective draws for the others


def test_the_table():
    path = SparsePath(6, 0.1, {3: 0.75, 4: 0.25}, 3, 50.0)
    bad = candidate(4, -2.0, loo=Loo(THREE[2].loo.elpd, np.r_[0.9, np.full(T - 1, 0.1)]))
    dark = candidate(2, -8.0, loo=Loo(np.ones(T), np.full(T, -np.inf)), misfit=UNKNOWN)
    lines = comparison.table(summary(dark, THREE[1], bad, path=path))
    assert lines[0].split()[:3] == ["facets", "ln", "Z"]
    assert len({len(line) for line in lines[:4]}) == 1
    assert len(lines[0]) <= 80
    assert "LOO from best" in lines[0]
    assert lines[1].rstrip().endswith("–")
    assert lines[2].strip().startswith("3 *")
    assert "sparse path from 6 facets ends, at the weight 0.1 /m⁴ (shares" in lines[4]
    assert "3: 0.75, 4: 0.25" in lines[4]
    assert lines[5].startswith("LOO of 4 facets rests")
    assert lines[-1].startswith("3 facets are most probable")
    assert lines[-1].endswith(".")


def test_a_number_that_is_ruled_out():
    """It has no probability, a bound in place of its evidence, and no particles."""
    out = RuledOut(1, 6, -1234.4, Misfit(2500.0, 34.0, "gaussian"))
    summary_content = summary(*THREE, ruled_out=[out])
    assert [row["probability"] for row in summary_content["candidates"]] == [
        row["probability"] for row in summary(*THREE)["candidates"]
    ]
    assert result(*THREE, ruled_out=[out]).probability[1] == 0.0
    lines = comparison.table(summary_content)
    assert lines[1].split()[:3] == ["1", "<", "-1234"]
    assert lines[1].rstrip().endswith("2500/34")
    assert "best fit alone, whose likelihood no evidence can exceed: 1 facet." in lines[5]
    figure = comparison_page.draw(
        summary_content["candidates"],
        comparison_page.style.Gallery(Path()),
        summary_content["ruled_out"],
    )
    assert any("< −1235" in text.get_text() for text in figure.axes[1].texts)
    assert figure.axes[0].get_xticks().tolist() == [1, 2, 3, 4]


def test_what_python_gets(tmp_path):
    got = result(*THREE, failed=[lost("5 facets: lost")])
    assert got.probability[3] == pytest.approx(0.95, abs=0.01)
    assert repr(got).startswith("<Comparison: NOT to be trusted>")
    assert "  - 5 facets: lost" in repr(got)
    assert list(got.summary()["n_facets"]) == [2, 3, 4]
    assert len(got.plot_evidence()) == 1
    got.save(tmp_path)
    assert {p.name for p in tmp_path.iterdir()} == {"summary.json", "tables", "run.toml", ".lock"}
    again = load(tmp_path)
    assert (again.reasons, again.trusted) == (got.reasons, False)
    assert again.summary().equals(got.summary())
    assert again.lines() == got.lines()


@pytest.mark.parametrize("good", [True, False])
def test_the_page(tmp_path, good, look):
    failed = [] if good else [lost("5 facets: <lost>"), lost(browser_pages.EVIL_TEXT)]
    summary_content = result(*THREE, failed=failed).content
    comparison_page.write_page(tmp_path, summary_content, RUN, CompareOptions)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert (tmp_path / "figures" / "compare.pdf").read_bytes().startswith(b"%PDF")
    assert ("Do not trust these numbers" in page) is not good
    assert ("5 facets: &lt;lost&gt;" in page) is not good
    assert "3 facets are most probable" in page
    assert "lcbayes compare /far/pass.csv --spin none --n-facets 2,3,4 --seed 3" in page
    assert "--num-particles 50 --sparse 6 --set omega_sd=0.1 --error-floor 0.01 -o DIR" in page
    assert 'src="data:image/svg+xml' in page
    assert "http://" not in page.replace("http://www.w3.org", "")
    assert not list(Path(tmp_path).glob(".*"))
    evil = RUN | {"curve": browser_pages.EVIL_FILE}
    comparison_page.write_page(tmp_path, summary_content, evil, CompareOptions)
    look(tmp_path / "report.html")


def test_the_figure_holds_far_differences():
    """Evidences thousands apart: the near ones stay on the scale, the far ones get an arrow."""
    rows = summary(candidate(1, -9000.0), *THREE)["candidates"]
    figure = comparison_page.draw(rows, comparison_page.style.Gallery(Path()))
    left, middle, _ = figure.axes
    assert middle.get_ylim()[0] > -20
    assert any("−9001" in text.get_text() for text in middle.texts)
    assert left.get_ylim()[1] > 1.0
