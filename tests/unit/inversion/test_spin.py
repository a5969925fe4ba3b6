"""Spin from periods: each formula against something else, each refusal where it belongs."""

from __future__ import annotations

import numpy as np
import pytest

from lcbayes.analysis import spin_report
from lcbayes.core.errors import InputError
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.spin import detrended, estimate, periods, pole, sidereal, windows
from lcbayes.inversion.spin.mean_frequency import mean_frequency
from lcbayes.inversion.spin.sidereal import MEASURABLE, RAPID, REPEATS, STABLE, UNIQUE
from lcbayes.physics.bodies import shapes
from lcbayes.results.reasons import reason as sentence
from lcbayes.tasks.spin.result import SpinResult
from tests.helpers.false_alarms import EACH, counts, squares
from tests.helpers.low_earth_orbit import shine, spinner, spun, steady, triad


def one_pass(t, y, error, name="a"):
    still = np.tile([0.0, 0.0, 1.0], (t.size, 1))
    return detrended.Pass(name, t, y, np.broadcast_to(error, t.shape).copy(), still, still)


def directions(rng, n):
    v = rng.normal(size=(n, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def test_the_periodogram_is_that_of_astropy():
    from astropy.timeseries import LombScargle

    rng = np.random.default_rng(1)
    t = np.sort(rng.uniform(0, 100, 200))
    y, error = rng.normal(size=200), rng.uniform(0.5, 2.0, 200)
    grid = np.linspace(0.03, 0.9, 300)
    ours = periods.power([one_pass(t, y, error)], grid)
    assert ours == pytest.approx(LombScargle(t, y, error).power(grid, method="cython"), abs=1e-12)


def test_shuffles_at_once_are_shuffles_one_by_one():
    rng = np.random.default_rng(2)
    made = [one_pass(np.sort(rng.uniform(0, 50, 60)), rng.normal(size=60), 1.0) for _ in range(2)]
    grid = np.linspace(0.1, 0.5, 40)
    data = [rng.normal(size=(60, 3)) for _ in made]
    together = periods.power(made, grid, data)
    for k in range(3):
        alone = periods.power(made, grid, [d[:, k] for d in data])
        assert together[:, k] == pytest.approx(alone, abs=1e-13)


def test_a_short_fast_pass_leaves_the_line_of_a_long_one():
    rng = np.random.default_rng(12)
    slow, fast = np.arange(0.0, 20000.0, 10.0), np.arange(30000.0, 30005.0, 0.05)
    made = [
        one_pass(t, 0.1 * np.sin(2 * np.pi * t / 125.7) + 0.02 * rng.normal(size=t.size), 0.02)
        for t in (slow, fast)
    ]
    grid = periods.frequencies(made)
    assert grid[0] == pytest.approx(periods.CYCLES / made[0].length)
    assert grid[-1] == pytest.approx(10.0)
    step, below = np.diff(grid), grid[1:] <= made[0].nyquist
    assert np.all(step > 0)
    assert step[below].max() * made[0].length < 1.001 / periods.OVERSAMPLING
    assert step.max() * made[1].length < 1.001 / periods.OVERSAMPLING
    assert len(grid) < 1.1 * periods.OVERSAMPLING * made[0].length * made[0].nyquist
    result = periods.power(made, grid)
    assert 1.0 / grid[np.argmax(result)] == pytest.approx(125.7, rel=2e-3)
    assert result.max() > 0.8


def test_a_long_dense_pass_is_searched_finely_or_not_at_all():
    t = np.arange(0.0, 86400.0, 0.5)
    (one,) = made = [one_pass(t, np.zeros(t.size), 1.0)]
    grid = periods.frequencies(made)
    assert len(grid) == periods.MAX_FREQUENCIES
    assert np.diff(grid).max() * one.length < 1.001 / periods.OVERSAMPLING


def test_periods_that_were_not_looked_for_are_reported(monkeypatch):
    curve = steady(1, 50.0, spinning=False)
    assert estimate(curve, n_shuffles=99).notes == []
    monkeypatch.setattr(periods, "MAX_FREQUENCIES", 100)
    result = estimate(curve, n_shuffles=99)
    assert len(result.grid) == 100
    (note,) = result.notes
    assert note.startswith(f"periods below {1 / result.grid[-1]:.3g} s (sampled to ")


def test_peaks_of_shuffles_do_not_hang_on_how_many_frequencies_are_taken_at_a_time(monkeypatch):
    rng = np.random.default_rng(13)
    made = [one_pass(np.sort(rng.uniform(0, 50, 60)), rng.normal(size=60), 1.0) for _ in range(2)]
    grid = np.linspace(0.1, 0.5, 40)
    at_once = periods.shuffled_peaks(made, grid, np.random.default_rng(1), 5)
    monkeypatch.setattr(periods, "SHUFFLED", 7)
    assert periods.shuffled_peaks(made, grid, np.random.default_rng(1), 5) == pytest.approx(at_once)


@pytest.mark.statistical(false_alarm=EACH)
def test_known_errors_find_periods_in_noise_no_more_often_than_is_said():
    rng = np.random.default_rng(14)
    times = [np.sort(rng.uniform(0, 50, 60)), np.arange(60.0, 65.0, 0.1)]
    error = [rng.uniform(0.5, 2.0, t.size) for t in times]
    trials, false = 300, 0
    for _ in range(trials):
        made = [
            one_pass(t, e * rng.normal(size=t.size), e) for t, e in zip(times, error, strict=True)
        ]
        grid = periods.frequencies(made)
        false += periods.chance(made, grid, periods.power(made, grid)) <= 0.05
    assert false <= counts(trials, 0.05)[1]


@pytest.mark.statistical(false_alarm=EACH)
def test_the_error_of_a_frequency_is_that_of_larsson_and_of_many_trials():
    n, span, f, sigma = 400, 60.0, 0.2, 0.3
    t = np.linspace(0, span, n)
    amplitudes = {1: 0.5, 2: 0.8}
    clean = sum(a * np.cos(2 * np.pi * k * f * t + k) for k, a in amplitudes.items())
    rng = np.random.default_rng(3)
    result, errors = [], []
    for _ in range(300):
        one = one_pass(t, clean + sigma * rng.normal(size=n), sigma)
        value, error = windows.frequency(one, np.arange(n), f * 1.002, [1, 2])
        result.append(value)
        errors.append(error)
    strength = sum((k * a) ** 2 for k, a in amplitudes.items())
    larsson = np.sqrt(6 / n) * sigma / (np.pi * span * np.sqrt(strength))
    assert np.median(errors) == pytest.approx(larsson, rel=0.05)
    z = (np.array(result) - f) / np.array(errors)
    low, high = squares(300)
    assert low < np.sum(z**2) < high * 1.05


def repeating(rng, drift: float, correlation_s: float, n: int = 400, span: float = 200.0):
    """One pass of period 20 s whose rate drifts, with noise of 0.18 that may be correlated.

    The last value is the truth: the slope of the straight line that fits the phase best.
    """
    t = np.linspace(0.0, span, n)
    x = 2.0 * t / span - 1.0
    cycles = (t + drift * span / 8.0 * (x**2 + (x**3 - 0.6 * x) / 1.5)) / 20.0
    y = sum(a * np.cos(2 * np.pi * k * cycles + k**2) for k, a in ((1, 0.12), (2, 0.25), (4, 0.15)))
    noise = rng.normal(size=n)
    if correlation_s:
        keep = np.exp(-(t[1] - t[0]) / correlation_s)
        for i in range(1, n):
            noise[i] = keep * noise[i - 1] + np.sqrt(1.0 - keep**2) * noise[i]
    return t, y + 0.18 * noise, np.polyfit(t, cycles, 1)[0]


@pytest.mark.statistical(false_alarm=EACH)
@pytest.mark.parametrize(("drift", "correlation_s"), [(0.0, 0.0), (0.01, 0.0), (0.01, 1.0)])
def test_the_stated_error_of_a_mean_period_holds_under_drift_and_correlated_noise(
    drift, correlation_s
):
    rng = np.random.default_rng(15)
    pulls = []
    for _ in range(300):
        t, y, truth = repeating(rng, drift, correlation_s)
        got = mean_frequency(one_pass(t, y, 0.18), truth * 1.002, [1, 2, 3, 4])
        pulls.append((got.frequency - truth) / got.error)
    low, high = squares(300)  # a standard deviation of 0.82 to 1.19
    assert low < np.sum(np.square(pulls)) < high


def test_a_drift_is_measured_with_its_error():
    t, y, _ = repeating(np.random.default_rng(16), 0.05, 0.0)
    got = mean_frequency(one_pass(t, y, 0.18), 0.05, [1, 2, 3, 4])
    assert got.drift == pytest.approx(0.05, abs=4 * got.drift_error)
    assert got.drift_error < 0.01


def test_the_base_is_found_from_its_second_harmonic():
    t = np.linspace(0, 300, 900)
    rng = np.random.default_rng(4)
    turn = 2 * np.pi * 0.05 * t
    y = 0.2 * np.cos(turn + 1) + 0.5 * np.cos(2 * turn) + 0.1 * np.cos(4 * turn)
    one = [one_pass(t, y + 0.05 * rng.normal(size=t.size), 0.05)]
    base, harmonics = periods.base(one, 0.1)
    assert base == pytest.approx(0.05)
    assert {1, 2, 4} <= set(harmonics)
    twice = [one_pass(t, y - 0.2 * np.cos(turn + 1) + 0.05 * rng.normal(size=t.size), 0.05)]
    assert periods.base(twice, 0.1)[0] == pytest.approx(0.1)


def fourier_azimuth(flux_of, harmonic: int) -> float:
    """Azimuth (modulo a turn over the harmonic) that flux(angle of the body) is even about."""
    angle = 2 * np.pi * np.arange(720) / 720
    coefficient = np.sum(flux_of(angle) * np.exp(1j * harmonic * angle))
    return float(np.angle(coefficient)) / harmonic


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(
    ("symmetry", "body", "spec", "harmonics"),
    [
        ("mean azimuth", shapes.body([[1, 0, 0], [-1, 0, 0]], [1.0, 1.0]), 0.0, (2, 4)),
        ("bisector", shapes.body([[1, 0, 0], [-1, 0, 0]], [1.0, 1.0]), 1.0, (2, 4)),
        ("rod", None, 0.0, (2, 4)),
    ],
)
def test_brightness_is_symmetric_about_the_azimuth_that_is_claimed(
    symmetry, body, spec, harmonics, seed
):
    """By Fourier analysis of facets summed one by one, the pole along z."""
    rng = np.random.default_rng(seed)
    while True:
        sun, obs = directions(rng, 2)
        both = sun + obs
        both /= np.linalg.norm(both)
        if sun @ obs > -0.2 and abs(both[2]) < 0.5 and max(abs(sun[2]), abs(obs[2])) < 0.85:
            break
    if body is None:
        side = shapes.cylinder(0.5, 3.0, 720)
        keep = np.array(side.labels) == "side"
        body = shapes.body(side.normals[keep][:, [2, 0, 1]], side.areas[keep])
    for harmonic in harmonics:

        def flux(angles):
            t = angles
            z = np.array([0.0, 0.0, 1.0])
            turn = [spun(np.tile(v, (t.size, 1)), t, z, 1.0) for v in (sun, obs)]
            return shine(body, turn[0], turn[1], spec, 4000.0)

        # the body frame's x axis lies at azimuth `angle` of the triad that `spun` uses
        e1, e2 = triad(np.array([0.0, 0.0, 1.0]))
        measured = fourier_azimuth(flux, harmonic)
        zenith = np.array([[0.0, 0.0, 1.0]])
        if symmetry == "rod":
            claimed = pole.rod_azimuth(zenith, sun[None], obs[None], harmonic)[0, 0]
        else:
            claimed = pole.symmetric_azimuth(zenith, sun[None], obs[None], symmetry)[0, 0]
        a, b = pole.axes(zenith)
        offset = np.arctan2(a[0] @ e2, a[0] @ e1)  # between the two conventions of axes
        assert b[0] @ e2 == pytest.approx(a[0] @ e1)
        difference = harmonic * (measured - claimed - offset)
        tolerance = {"mean azimuth": 2e-3, "rod": 0.01, "bisector": 0.05}[symmetry]  # a finite lobe
        assert abs(np.angle(np.exp(1j * difference))) < tolerance


def test_azimuths_run_the_other_way_about_the_other_pole():
    rng = np.random.default_rng(5)
    path = np.array([1.0, 0.5, 0.2]) + np.cumsum(0.05 * rng.normal(size=(40, 3)), axis=0)
    p = directions(rng, 3)
    there, back = pole.azimuths(p, path), pole.azimuths(-p, path)
    assert np.diff(there, axis=1) == pytest.approx(-np.diff(back, axis=1), abs=1e-12)


def test_a_synodic_rate_is_the_sidereal_rate_less_that_of_the_azimuth():
    """A mirror that turns: times of its flashes against Ω t − λ(t)."""
    rng = np.random.default_rng(6)
    p = directions(rng, 1)
    t = np.arange(0, 400, 0.01)
    angle = 0.002 * t
    vector = np.stack([np.cos(angle), np.sin(angle), 0.4 * np.ones_like(t)], axis=1)
    vector /= np.linalg.norm(vector, axis=1, keepdims=True)
    omega = 0.5
    body = spun(vector, t, p[0], omega)
    flashes = t[1:][(np.diff(np.sign(body[:, 1])) != 0) & (body[1:, 0] > 0)]
    e1, _ = triad(p[0])
    lam = pole.azimuths(p, vector)[0]
    turns = (omega * flashes - np.interp(flashes, t, lam)) / (2 * np.pi)
    assert np.diff(turns) == pytest.approx(1.0, abs=1e-3)
    assert e1.shape == (3,)


@pytest.fixture(scope="module")
def cylinder():
    curve, truth = spinner(2013, 4, 50.0, "cylinder")
    return estimate(curve), truth


def test_pole_and_period_of_a_cylinder(cylinder):
    result, truth = cylinder
    assert not result.reasons
    best = result.solutions[0]
    assert np.degrees(np.arccos(best.pole @ truth["pole"])) < 10.0
    assert 1 / best.frequency == pytest.approx(truth["period"], rel=1e-3)
    near = np.argmax(result.sky.poles @ truth["pole"])
    assert result.sky.region()[near]
    # the other sense of rotation is told apart
    other = result.sky.poles @ truth["pole"] < -0.7
    assert result.sky.weight[other].sum() < 0.02


def test_regions_hold_their_probability_and_solutions_their_weights(cylinder):
    result, _ = cylinder
    total = result.sky.weight.sum(axis=1)
    assert total.sum() == pytest.approx(1.0)
    inside = result.sky.region()
    assert 0.9 <= total[inside].sum() < 0.9 + total[inside].min() + 1e-12
    assert 0.9 <= sum(s.weight for s in result.solutions) < 0.93


def test_a_region_too_large_is_listed_but_is_no_solution(cylinder, monkeypatch):
    small, truth = cylinder
    assert not small.too_wide
    monkeypatch.setattr(sidereal, "MAX_AREA", 1e-4)
    curve, _ = spinner(2013, 4, 50.0, "cylinder")
    found = estimate(curve)
    assert [r.code for r in found.reasons] == ["pole-undetermined"]
    assert not found.solutions
    for one, same in zip(found.too_wide, small.solutions, strict=True):
        assert one.pole @ same.pole == pytest.approx(1.0)
        assert (one.frequency, one.weight) == pytest.approx((same.frequency, same.weight))
    content = SpinResult(found, curve).content
    assert content["solutions"] == []
    assert content["region"][0]["period_s"] == pytest.approx(truth["period"], rel=1e-3)
    told = "\n".join(spin_report.words(found, curve))
    assert "no pole is given, but these are the parts of its 90 % region:\nweight" in told
    offered = [seconds for _, seconds in SpinResult(found, curve).candidates()]  # for folding
    assert offered[1:] == [one["period_s"] for one in content["region"]][:4]


def test_two_passes_give_no_pole():
    """In 5 of 15 simulated cylinders their 90 % region held the pole."""
    result = estimate(spinner(100_001, 2, 100.0, "cylinder")[0], n_shuffles=99)
    assert result.sky is not None
    assert "too-few-passes" in {r.code for r in result.reasons}
    assert not result.solutions


def test_many_solutions_over_a_factor_of_four_in_period_are_no_answer():
    """Candidates are listed, and the verdict says that they are no answer."""
    result = estimate(spinner(102_006, 6, 20.0, "cylinder")[0], n_shuffles=99)
    turn = [1 / s.frequency for s in result.solutions]
    assert len(turn) > 4
    assert max(turn) > 3.5 * min(turn)
    codes = {r.code for r in result.reasons}
    assert codes
    assert codes <= {"ambiguous-period", "many-poles"}
    assert {c.name for c in result.conditions if not c.met} == {UNIQUE}


def failed(curve) -> set[str]:
    return {c.name for c in estimate(curve, n_shuffles=99).conditions if not c.met}


def test_noise_has_no_period():
    assert failed(steady(1, 50.0, spinning=False)) == {REPEATS}


@pytest.mark.parametrize("value", [1.0, 0.1])
@pytest.mark.parametrize(("error", "ripple"), [(None, 0.0), (0.01, 0.0), (0.01, 1e-6)])
def test_a_constant_has_no_period(value, error, ripple):
    """What its rounding shows has structure, which no shuffle has, but no size."""
    t = np.arange(0.0, 600.0, 2.0)
    a = np.radians(20.0 + 0.1 * t)
    curve = LightCurve(
        t=t,
        brightness=value * (1.0 + ripple * np.sin(t / 5.0)),
        error=None if error is None else np.full(t.size, error),
        sun=np.tile([0.6, 0.0, 0.8], (t.size, 1)),
        obs=np.stack([np.cos(a), np.sin(a), 0 * a], 1),
    )
    result = estimate(curve, n_shuffles=99)
    assert result.false_alarm == 1.0
    assert result.reasons[0].code == "no-period"
    assert "no period is seen" in sentence(result.reasons[0]).text


def test_a_few_very_faint_points_do_not_hide_a_period():
    """Their errors are relative, and would give them all the weight."""
    t = np.arange(0.0, 270.0)
    a = np.radians(20.0 + 0.1 * t)
    flux = 1.0 + 0.6 * np.cos(2 * np.pi * t / 15.5)
    flux[[30, 31, 140, 211]] = [1e-5, 3e-5, 2e-5, 6e-5]
    curve = LightCurve(
        t=t,
        brightness=-2.5 * np.log10(flux) + 0.04 * np.random.default_rng(2).normal(size=t.size),
        error=np.full(t.size, 0.04),
        sun=np.tile([0.6, 0.0, 0.8], (t.size, 1)),
        obs=np.stack([np.cos(a), np.sin(a), 0 * a], 1),
        kind="mag",
    )
    result = estimate(curve, n_shuffles=199)
    assert result.false_alarm <= 0.01
    assert result.base == pytest.approx(1 / 15.5, rel=5e-3)


def test_where_nothing_moves_no_difference_is_measured():
    assert failed(steady(1, 50.0, spinning=True)) == {MEASURABLE}


def changed(flux_of, seed=0, snr=100.0):
    rng = np.random.default_rng(seed)
    base = steady(0, snr, spinning=False)
    flux = flux_of(base.t)
    error = np.full(base.n_obs, flux.mean() / snr)
    return LightCurve(
        t=base.t,
        brightness=flux + error * rng.normal(size=base.n_obs),
        error=error,
        sun=base.sun,
        obs=base.obs,
    )


def test_a_slow_spin_a_tumbler_and_a_single_flash_are_refused():
    assert failed(changed(lambda t: 2 + np.cos(2 * np.pi * t / 90))) == {RAPID}
    tumbling = changed(
        lambda t: 3 + np.cos(2 * np.pi * t / 20) + 0.8 * np.cos(2 * np.pi * t / 31.3)
    )
    assert STABLE in failed(tumbling)
    flash = changed(lambda t: 1 + 5 * np.exp(-0.5 * ((t % 6000 - 170) / 6.0) ** 2))
    assert failed(flash) & {REPEATS, STABLE, RAPID}


def test_a_line_within_the_resolution_of_a_subharmonic_is_the_subharmonic():
    """A tenth of 1/T apart, as on the first stretch of the Ariane stage: 22.16 and 45.02 s."""
    assert periods.subharmonic(1 / 22.16, 1 / 45.02, 1 / 300.0) == 2
    assert periods.subharmonic(1 / 22.16, 1.5 / 22.10, 1 / 300.0) == 2
    assert periods.subharmonic(1 / 10.0, 1 / 30.2, 1 / 300.0) == 3
    assert periods.subharmonic(1 / 20.0, 1 / 31.3, 1 / 400.0) == 0
    assert periods.subharmonic(1 / 20.0, 1 / 20.1, 1 / 400.0) == 0


def test_a_period_too_long_for_the_pass_is_not_taken_for_tumbling():
    """Half of it repeats often enough; the whole of it five times only."""
    result = estimate(
        changed(
            lambda t: (
                3
                + np.cos(2 * np.pi * t / 40)
                + 0.5 * np.cos(2 * np.pi * t / 80)
                + 0.4 * np.cos(2 * np.pi * 3 * t / 80 + 1)
            )
        ),
        n_shuffles=99,
    )
    (reason,) = result.reasons
    assert reason.code == "too-few-cycles"
    assert " 80" in sentence(reason).text or " 79." in sentence(reason).text


def test_a_curve_without_a_dense_pass_is_refused_in_one_line():
    curve = steady(0, 50.0, spinning=False)
    with pytest.raises(InputError, match="no pass has 30 points"):
        estimate(curve.select(np.arange(0, 1000, 40)))
