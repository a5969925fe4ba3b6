"""Residuals of asteroids: a late curve is named, and relative curves have a phase law.

The curves are those of an ellipsoid by a simulator without any code of the package.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

import lcbayes
from benchmarks import _asteroids as asteroids
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.data.lightcurve import LightCurve
from lcbayes.geometry.spherical import unit_vector
from lcbayes.inference import robustness
from lcbayes.inference.goodness_of_fit import measure
from lcbayes.inference.misfit_tests import Examination, examine
from lcbayes.inference.solutions import optimum
from lcbayes.modelling import registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem, compiled
from lcbayes.models import convex_grid
from lcbayes.results import summary
from lcbayes.results.reasons import agreement, reason
from lcbayes.results.summary import _examined

LATE_MIN, LATE = 20.0, 3  # the times of the fourth curve
SPIN: tuple[str, ...] = ("period_h", "pole_lat_deg", "pole_lon_deg")


@pytest.fixture(scope="module")
def case() -> asteroids.Case:
    """Six nights of some six years, of 50 points of 1 % each."""
    return asteroids.draw_case("ellipsoid", 2)


class Best(NamedTuple):
    """The best fit about the true pole and period."""

    problem: Problem
    z: np.ndarray
    data: Epochs
    curve: LightCurve

    @property
    def spin(self) -> np.ndarray:
        sites = compiled(self.problem.constrain)(jnp.asarray(self.z), self.data)
        return np.array([float(sites[name]) for name in SPIN])


def best(case: asteroids.Case, folder, **changes: tuple[int, ...]) -> Best:
    asteroids.write(case, folder / "asteroid.lcs")
    curve = lcbayes.read(folder / "asteroid.lcs")
    options = {"period": case.period_h, "degree": 4, "n_facets": 100, "n_quadrature": 300}
    data = replace(Epochs.of(curve), **changes)
    problem = Problem(registry.find("convex-grid").bind(options), data)
    (sphere, *_) = convex_grid.starts(data, jax.random.key(0), degree=4)
    middle = {"pole_base": jnp.asarray(case.pole)[None], "period_shift": jnp.zeros(())}
    start = np.asarray(problem.ravel(sphere | middle))
    z, _ = optimum(problem, data, start, np.arange(problem.dim))
    return Best(problem, z, data, curve)


def examined(
    case: asteroids.Case, folder, **changes: tuple[int, ...]
) -> tuple[Examination, Epochs]:
    """The residuals of the best fit."""
    found = best(case, folder, **changes)
    return examine(*found), found.data


def late(case: asteroids.Case, minutes: float) -> asteroids.Case:
    """The case with late times of one curve."""
    return replace(case, t=case.t + np.where(case.curve == LATE, minutes / 1440.0, 0.0))


def test_curves_on_time_show_no_pattern(case, tmp_path):
    found, _ = examined(case, tmp_path)
    assert not found.refused
    said = agreement([1.0], {"chi2": None} | _examined(found))
    assert said.endswith("The size of the noise is inferred; the residuals show no pattern.")


def test_a_late_curve_is_named_with_its_amount(case, tmp_path):
    found, data = examined(late(case, LATE_MIN), tmp_path)
    assert not data.has_error
    assert "chi2" not in {test.name for test in found.tests}  # of an inferred noise, it is n
    cause = found.cause
    assert cause is not None
    assert cause.name == "late-curve"
    assert cause.version == f"curve {LATE + 1} (2005-06-05)"
    assert cause.amount == pytest.approx(-LATE_MIN, abs=3.0 * cause.sd)
    assert cause.sd < 0.25 * LATE_MIN
    said = agreement([1.0], {"chi2": None} | _examined(found))
    assert f"the times of {cause.version} are" in said
    assert said.endswith("min too late.")
    assert cause.rough == ("a rough guess" in said)


def test_late_times_move_the_spin_as_far_as_is_stated(case, tmp_path):
    """Beside the spins of fits to times that are late and early by three minutes.

    The information, by which the shifts are stated, leaves out second derivatives.
    """
    found = best(case, tmp_path)
    shifts = robustness.shifts(*found, dict.fromkeys(SPIN, 1.0))
    columns = [shifts.quantities.index(name) for name in SPIN]
    stated = shifts.by_curve[:, columns]
    assert len(stated) == 6
    np.testing.assert_array_equal(stated.max(axis=0), shifts.by_fault["late_curve_1_min"][columns])
    later, earlier = (best(late(case, minutes), tmp_path).spin for minutes in (3.0, -3.0))
    moved = np.abs(later - earlier) / 6.0
    np.testing.assert_allclose(stated[LATE, :2], moved[:2], rtol=0.2)
    assert stated[LATE, 2] < 0.1 > moved[2]  # hardly


@pytest.mark.parametrize(("sd_deg", "refused"), [(4.0, True), (8.0, False)])
def test_a_late_curve_that_moves_the_pole_refuses_the_fit(case, tmp_path, sd_deg, refused):
    """It is refused where the spin moves by more than half of its uncertainty."""
    found = best(late(case, LATE_MIN), tmp_path)
    sd: dict[str, float] = dict(zip(SPIN, (1.0, sd_deg, sd_deg), strict=True))
    shifts = robustness.shifts(*found, sd)
    misfit = measure(found.problem, found.data, found.z[None], examine(*found))
    assert misfit.explained  # its noise is inferred
    reasons_given = [reason(one) for one in summary._late_curve(misfit, shifts, found.curve)]
    assert [one.code for one in reasons_given] == ["curve-appears-late"] * refused
    for one in reasons_given:
        assert "curve 4 (2005-06-05) are" in one.text
        assert "min too late" in one.text
        assert "moves the latitude of the pole by" in one.text


def sparse(case: asteroids.Case, *slopes: float) -> asteroids.Case:
    """Two curves of points at all phase angles, which fade by mag/deg."""
    phase = np.arccos(np.sum(asteroids.unit(case.sun) * asteroids.unit(case.earth), axis=1))
    curve = np.tile(np.arange(2), case.t.size // 2)
    faded = 10.0 ** (-0.4 * np.array(slopes)[curve] * np.degrees(phase))
    return replace(case, flux=case.flux * faded, curve=curve)


@pytest.mark.slow
def test_a_relative_curve_that_covers_phase_angles_has_a_phase_law(case, tmp_path):
    found, data = examined(sparse(case, 0.035, 0.015), tmp_path)
    assert data.phased == (0, 1)
    assert not found.refused
    without, _ = examined(sparse(case, 0.01, 0.01), tmp_path, phased=())
    slope = next(one for one in without.explanations if one.name == "phase-slope")
    assert slope.p_value < without.limit
    assert slope.amount == pytest.approx(np.degrees(0.01), rel=0.2)


def test_an_apparition_of_another_zero_point_is_named(case, tmp_path):
    """The second of two surveys is fainter by 0.1 mag in its second apparition."""
    two = sparse(case, 0.0, 0.0)
    year = np.floor((two.t - two.t.min()) / 365.25).astype(int)
    jumps = np.where((two.curve == 1) & (year == 1), 0.1, 0.0)
    found, _ = examined(replace(two, flux=two.flux * 10.0 ** (-0.4 * jumps)), tmp_path)
    assert "apparition" in {test.name for test in found.refused}
    cause = found.cause
    assert cause is not None
    assert cause.name == "faint-apparition"
    assert cause.version == "curve 2 (2001-09-04) from 2002-10-15 to 2002-10-15"
    assert cause.amount == pytest.approx(0.1, abs=3.0 * cause.sd)
    assert cause.sd < 0.02
    said = agreement([1.0], {"chi2": None} | _examined(found))
    assert "mag fainter than in other apparitions" in said
    even, _ = examined(two, tmp_path)
    assert not even.refused


@pytest.mark.slow
def test_a_scan_of_curves_that_cover_phase_angles_finds_the_pole(tmp_path):
    """Two surveys of other slopes; without a phase law the residuals are 10 %."""
    truth = asteroids.draw_case("ellipsoid", 4)
    asteroids.write(sparse(truth, 0.035, 0.015), tmp_path / "asteroid.lcs")
    curve = lcbayes.read(tmp_path / "asteroid.lcs")
    found = lcbayes.scan(curve, period=truth.period_h, n_sky=0, n_poles=6)
    poles = [
        unit_vector(*np.radians([one.get("pole_lon_deg", np.nan), one.get("pole_lat_deg", np.nan)]))
        for one in found.solutions
        if one["near_equal"]
    ]
    assert found.solutions[0]["rms"] < 0.011  # simulated with 0.01
    assert min(np.degrees(np.arccos(pole @ truth.pole)) for pole in poles) < 3.0


@pytest.mark.slow
def test_the_search_finds_relief_from_a_sphere(tmp_path):
    """A contact binary; a smooth body fits it half as well, and stays smooth by its prior."""
    binary = asteroids.draw_case("binary", 0)
    asteroids.write(binary, tmp_path / "asteroid.lcs")
    data = Epochs.of(lcbayes.read(tmp_path / "asteroid.lcs"))
    options = {"period": binary.period_h}
    full, coarse = (
        Problem(registry.find("convex-grid").bind(options | other), data)
        for other in ({}, convex_grid.COARSER)
    )
    (sphere, *_) = convex_grid.starts(data, jax.random.key(0))
    middle = {"pole_base": jnp.asarray(binary.pole)[None], "period_shift": jnp.zeros(())}
    start = np.asarray(full.ravel(sphere | middle))
    every = np.arange(full.dim)
    found, _ = optimum(coarse, data, start, every)
    z, potential = optimum(full, data, found, every)
    _, smooth = optimum(full, data, start, every)
    assert potential < smooth - 50.0
    assert float(full.constrain(jnp.asarray(z), data)["sigma"]) < 0.0105  # simulated with 0.01


def test_curves_of_one_night_have_no_phase_law(case, tmp_path):
    asteroids.write(case, tmp_path / "asteroid.lcs")
    data = Epochs.of(lcbayes.read(tmp_path / "asteroid.lcs"))
    assert data.phased == ()
    problem = Problem(registry.find("convex-grid").bind({"period": case.period_h}), data)
    assert "phase_k" not in problem.names
