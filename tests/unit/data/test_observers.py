"""Which points share a clock and a zero point."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lcbayes.data.lightcurve import LightCurve
from lcbayes.data.observers import calibrations, direction_rates, matched, observers

DAY = 86400.0


def unit(v):
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def curve(t, obs=None, **changes) -> LightCurve:
    t = np.asarray(t, float)
    if obs is None:
        obs = np.tile([0.0, 0.6, 0.8], (t.size, 1))
    given = {"error": None, "sun": np.tile([1.0, 0.0, 0.0], (t.size, 1))}
    return LightCurve(t=t, brightness=np.ones(t.size), obs=obs, **(given | changes))


def two_places(n: int = 20, gap_deg: float = 8.0) -> LightCurve:
    """Two observers at the same times, whose directions turn by 0.5 deg/s."""
    t = np.repeat(np.arange(n, dtype=float), 2)
    angle = np.radians(0.5 * t + gap_deg * (np.arange(2 * n) % 2))
    return curve(t, np.stack([0 * t, np.sin(angle), np.cos(angle)], 1))


def test_named_sites_are_the_observers():
    result = observers(curve(np.arange(4.0), site=np.array(["b", "a", "b", "a"])))
    assert result.names == ("a", "b")
    assert result.index.tolist() == [1, 0, 1, 0]
    assert result.source == "site"


def test_directions_that_one_observer_cannot_have_are_those_of_two():
    result = observers(two_places())
    assert result.source == "directions"
    assert result.index.tolist() == [0, 1] * 20
    assert result.names == ("observer 1", "observer 2")


def test_one_observer_stays_one():
    one = two_places().select(np.arange(0, 40, 2))
    assert observers(one).source == "none"
    assert observers(one).index.max() == 0
    rng = np.random.default_rng(0)
    anywhere = curve(np.arange(30.0), unit(rng.normal(size=(30, 3))))  # no track of four points
    assert observers(anywhere).source == "none"
    copies = anywhere.select(np.repeat(np.arange(30), 10))  # as in several bands at once
    assert observers(copies).source == "none"


def test_observers_of_two_passes_are_not_identified():
    both = two_places()
    light = curve(np.append(both.t, both.t + 5000.0), np.tile(both.obs, (2, 1)))
    result = observers(light)
    assert result.index.max() == 3
    assert result.names[3] == "observer 2 of pass 2"


def test_zero_points_are_of_one_curve_site_and_night():
    t = np.array([0.0, 1.0, 2.0, 3.0, DAY, DAY + 1])
    light = curve(t, site=np.array(["a", "b", "a", "b", "a", "a"]))
    result = calibrations(light, observers(light))
    assert result.index.tolist() == [0, 2, 0, 2, 1, 1]
    assert result.names == ("a, night 1", "a, night 2", "b")
    assert result.last.tolist() == [2.0, DAY + 1, 3.0]
    assert result.series.tolist() == [0, 0, 1]
    assert result.series_names == ("a", "b")
    assert calibrations(light.select([0, 1]), observers(light.select([0, 1]))).series_names == ()
    same_night = calibrations(light.select([0, 2]), observers(light.select([0, 2])))
    assert same_night.index.tolist() == [-1, -1]
    assert same_night.names == ()


def test_an_unknown_scale_of_one_night_is_no_zero_point():
    t = np.array([0.0, 1.0, 0.0, DAY, 0.0, 1.0])
    light = curve(
        t,
        curve=np.array([0, 0, 1, 1, 2, 2]),
        free_scale=np.array([True, True, False]),
        curve_names=("own", "two nights", "known"),
    )
    result = calibrations(light, observers(light))
    assert result.index.tolist() == [-1, -1, 0, 1, 2, 2]
    assert result.names[:2] == ("curve two nights, night 1", "curve two nights, night 2")
    free = replace(light.select([0, 1, 4, 5]), free_scale=np.ones(2, bool))
    assert calibrations(free, observers(free)).names == ()


def test_other_epochs_find_their_night_and_site():
    light = curve([0.0, DAY, DAY, DAY + 1], site=np.array(["a", "a", "b", "b"]))
    wanted = curve([100.0, DAY, DAY, 2 * DAY], site=np.array(["a", "b", "c", "a"]))
    result = matched(wanted, wanted.t, light)
    assert result.observer.tolist() == [0, 1, 2, 0]
    assert result.calibration.tolist() == [0, 2, 3, 3]
    assert result.series.tolist() == [0, 1, 2, 0]
    assert result.observers.names == result.calibrations.series_names == ("a", "b")


def test_rates_are_those_of_one_observer():
    light = two_places()
    sun, obs = direction_rates(light, observers(light))
    np.testing.assert_array_equal(sun, 0.0)
    np.testing.assert_allclose(np.linalg.norm(obs[2:-2], axis=1), np.radians(0.5), rtol=1e-4)
    alone = curve([0.0, 5000.0])
    np.testing.assert_array_equal(direction_rates(alone, observers(alone)), 0.0)
