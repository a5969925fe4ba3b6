"""A curve whose times are wrong contradicts the period of the others."""

from dataclasses import replace

import numpy as np
import pytest

from lcbayes.core.reasons import Finding
from lcbayes.data.lightcurve import LightCurve
from lcbayes.geometry.spherical import unit_vector
from lcbayes.inversion.attitude_scan import evidence, sphere_cells, verdict
from lcbayes.inversion.attitude_scan.contradiction import Contradiction, _of_period, contradiction
from lcbayes.inversion.attitude_scan.evidence import Cells
from lcbayes.inversion.attitude_scan.harmonics import SparsePoints
from lcbayes.inversion.attitude_scan.result import AttitudeScan, Solution
from lcbayes.inversion.attitude_scan.sparse import SparseSearch, Spin
from lcbayes.results.reasons import reasons
from tests.helpers import egg_nights
from tests.helpers.egg_nights import PERIOD_H

LATE, SURVEY = 3, 7  # curves whose times are wrong
LEVEL = 2


def near_the_period_and_twice_it(points: SparsePoints) -> Cells:
    """Cells of all poles at frequencies near the true one and half of it."""
    number, apart = sphere_cells.number(LEVEL), 0.25 / points.span
    near = [1.0 / (3600.0 * PERIOD_H * k) + apart * np.arange(-2, 3) for k in (1, 2)]
    frequency = np.concatenate(near)
    found = evidence.cells(
        points,
        np.tile(np.arange(number), len(frequency)),
        LEVEL,
        np.repeat(frequency, number),
        np.full(number * len(frequency), apart),
    )
    return evidence.located(points, found)


def period_h(frequency: float) -> float:
    return 1.0 / (3600.0 * frequency)


def found(curve: LightCurve) -> tuple[float, Contradiction | None]:
    """The best period (h), and the curve that contradicts the others."""
    points = SparsePoints.of(curve)
    cells = near_the_period_and_twice_it(points)
    best = float(cells.frequency[np.argmax(cells.log_evidence)])
    return period_h(best), contradiction(points, cells)


def test_curves_with_right_times_agree():
    best, against = found(egg_nights.observed())
    assert best == pytest.approx(PERIOD_H, rel=1e-4)
    assert against is None


def test_a_night_an_hour_early_contradicts_the_others():
    """It makes twice the period the more probable by many nats."""
    best, against = found(egg_nights.observed(1.0, LATE))
    assert best == pytest.approx(2.0 * PERIOD_H, rel=1e-3)
    assert against is not None
    assert against.curves == (LATE,)
    assert period_h(against.frequency) == pytest.approx(PERIOD_H, rel=1e-4)
    assert against.probability > 0.99
    assert against.moved
    assert against.agree < 0.5
    assert degrees_apart(against.poles[0], *egg_nights.POLE_DEG) < 10.0


def degrees_apart(pole: np.ndarray, lon: float, lat: float) -> float:
    return float(np.degrees(np.arccos(pole @ unit_vector(*np.radians([lon, lat])))))


def test_the_period_without_a_curve_has_both_its_poles():
    """Of three nights and the survey: the pole, and its mirror image, which fits nearly as well."""
    curve = egg_nights.observed(1.0, LATE)
    points = SparsePoints.of(curve.select(curve.curve >= LATE))
    lon, lat = egg_nights.POLE_DEG
    start = unit_vector(*np.radians([lon, lat]))
    poles, frequencies, shares = _of_period(points, 0, start, 1.0 / (3600.0 * PERIOD_H))
    assert len(poles) == 2
    assert degrees_apart(poles[0], lon, lat) < 10.0
    assert degrees_apart(poles[1], lon + 180.0, lat) < 20.0
    assert 1.0 / (3600.0 * frequencies) == pytest.approx(PERIOD_H, rel=1e-4)
    others = points._replace(used=points.used * (1.0 - points.group[:, 0]))
    odds = np.exp(np.diff(evidence.all_shapes(others, poles, frequencies)))
    assert shares == pytest.approx(np.array([1.0, *odds]) / (1.0 + odds[0]), rel=1e-6)


def test_a_survey_of_early_times_is_named():
    against = found(egg_nights.observed(1.5, SURVEY))[1]
    assert against is not None
    assert against.curves == (SURVEY,)
    assert period_h(against.frequency) == pytest.approx(PERIOD_H, rel=1e-4)
    assert against.moved


def test_two_curves_are_both_named():
    """Whichever is moved, they agree."""
    curve = egg_nights.observed(-2.0, SURVEY)
    points = SparsePoints.of(curve.select(curve.curve >= SURVEY - 1))
    against = contradiction(points, near_the_period_and_twice_it(points))
    assert against is not None
    assert sorted(against.curves) == [0, 1]


def test_the_period_without_the_curve_has_the_probability_that_it_is_wrong():
    pole, right = np.array([0.0, 0.0, 1.0]), 1.0 / (3600.0 * PERIOD_H)
    spins = [Spin(pole, 0.5 * right, 0.7, 0.0, 0.9), Spin(-pole, 0.5 * right, 0.2, 0.0, 0.9)]
    spins += [Spin(pole, right, 0.06, 0.0, 0.1), Spin(-pole, right, 0.04, 0.0, 0.1)]
    none = np.zeros(0)
    search = SparseSearch(spins, none, none, np.zeros((0, 3)), 0, Cells(*6 * [none]))
    poles, shares = np.stack([pole, -pole]), np.array([0.8, 0.2])
    against = Contradiction((LATE,), poles, np.full(2, right), shares, 0.999, moved=True, agree=0.1)
    rest = 0.9 * 0.999
    left = against.doubted(search, span=1e7).spins
    share = [0.6 * (0.01 + rest), 0.4 * (0.01 + rest), 0.07, 0.02]
    np.testing.assert_allclose([s.probability for s in left], share)
    of_period = [0.01 + rest, 0.01 + rest, 0.09, 0.09]
    np.testing.assert_allclose([s.period_probability for s in left], of_period)
    left = against.doubted(replace(search, spins=spins[:2]), span=1e7)
    assert left.spins[0].frequency == right
    share = [0.8 * rest, 0.2 * rest, 0.07, 0.02]
    np.testing.assert_allclose([s.probability for s in left.spins], share)
    assert left.period_probability == pytest.approx(rest)


def test_times_are_moved_by_parts_of_a_turn():
    """As if the points had been given with these times."""
    points = SparsePoints.of(egg_nights.observed())
    pole, frequency = np.array([[0.0, 0.6, 0.8]] * 2), np.array([1.0, 1.1]) / (3600.0 * PERIOD_H)
    turns = np.array([0.25, 0.6])
    moved = points.group[:, LATE]
    value = evidence.all_shapes_moved(points, pole, frequency, moved, turns)
    for i in range(2):
        later = points._replace(t=points.t + moved * turns[i] / frequency[i])
        expected = evidence.all_shapes(later, pole[i : i + 1], frequency[i : i + 1])
        assert value[i] == pytest.approx(expected[0], abs=1e-6)


def test_one_curve_has_no_others():
    curve = egg_nights.observed().select(egg_nights.observed().curve == 7)
    points = SparsePoints.of(curve)
    one = np.zeros(1)
    cells = Cells(one.astype(int), one.astype(int), one + 3e-5, one + 1e-9, one, one)
    assert contradiction(points, cells) is None


@pytest.mark.parametrize("moved", [False, True])
def test_the_verdict_names_the_curves(moved):
    curve = egg_nights.observed()
    none = np.zeros(0)
    best = Solution(
        "constant-rate", 1.0, 0.01, none, np.zeros((0, 3)), none, 1,
        np.array([0.0, 0.0, 1.0]), 1.0 / (7200.0 * PERIOD_H), probability=1.0,
    )  # fmt: skip
    scan = AttitudeScan(
        None, [best], curve.n_obs, curve.n_obs, False, curve.frame, curve.t, curve.curve, none,
        period_probability=1.0,
        contradiction=Contradiction(
            (LATE, 0), np.array([[0.0, 0.0, 1.0]]), np.array([1.0 / (3600.0 * PERIOD_H)]),
            np.ones(1), 0.99999, moved, 0.01,
        ),
    )  # fmt: skip
    finding: Finding = next(verdict.contradicted(scan, curve))
    (reason,) = reasons([finding])
    assert reason.code == "curve-contradicts"
    assert reason.text.startswith("curve 4 (20")
    assert ") or curve 1 (20" in reason.text
    assert "9.21370 h" in reason.text
    assert "probability above 0.9999" in reason.text
    assert ("moved in time" in reason.text) == moved
