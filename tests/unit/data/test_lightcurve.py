"""What a `LightCurve` accepts, what it makes of it, and what it says of the rest."""

import numpy as np
import pytest

from lcbayes.core.errors import InputError, RowError
from lcbayes.data.lightcurve import LightCurve


def parts(n=4, **changes):
    """Arguments of a small valid curve."""
    angle = np.linspace(0.1, 1.3, n)
    given = {
        "t": np.arange(n) * 2.0,
        "brightness": np.full(n, 3.0),
        "error": np.full(n, 0.1),
        "sun": np.stack([np.cos(angle), np.sin(angle), 0 * angle], 1),
        "obs": np.tile([1.0, 0.0, 0.0], (n, 1)),
    }
    return given | changes


def test_completes_what_is_absent():
    curve = LightCurve(**parts())
    assert (curve.n_obs, curve.n_curves, curve.curve_names) == (4, 1, ("0",))
    assert not curve.free_scale.any()
    assert (curve.band == "").all()
    assert (curve.exposure_s == 0).all()
    assert not curve.geometry_only
    np.testing.assert_allclose(curve.phase_angle, np.linspace(0.1, 1.3, 4), rtol=1e-14)
    assert repr(curve) == (
        "LightCurve(4 points, 1 curves (0 of unknown scale), flux, errors given, ranges unknown, "
        "6 s, inertial)"
    )


def test_phase_angle_is_exact_near_zero_and_pi():
    sun = np.array([[np.cos(1e-9), np.sin(1e-9), 0], [-np.cos(1e-9), np.sin(1e-9), 0]])
    curve = LightCurve(**parts(2, sun=sun))
    np.testing.assert_allclose(curve.phase_angle, [1e-9, np.pi - 1e-9], rtol=1e-12)


def test_select_keeps_the_names_of_the_curves_left():
    curve = LightCurve(
        **parts(
            curve=[0, 1, 2, 2],
            curve_names=("a", "b", "c"),
            free_scale=[True, False, True],
            range_km=[1.0, 2.0, 3.0, 4.0],
            extra={"note": np.array(["p", "q", "r", "s"])},
        )
    )
    some = curve.select(np.array([True, False, True, True]))
    assert some.curve_names == ("a", "c")
    assert some.curve.tolist() == [0, 1, 1]
    assert some.free_scale.tolist() == [True, True]
    assert some.range_km is not None
    assert some.range_km.tolist() == [1.0, 3.0, 4.0]
    assert some.extra["note"].tolist() == ["p", "r", "s"]
    with pytest.raises(InputError, match="holds no points"):
        curve.select(np.zeros(4, bool))


def test_equal_times_are_two_measurements_and_curves_may_overlap():
    assert LightCurve(**parts(t=[0.0, 1.0, 1.0, 2.0])).n_obs == 4
    assert LightCurve(**parts(t=[0.0, 5.0, 1.0, 6.0], curve=[0, 1, 0, 1])).n_curves == 2


nan = np.nan


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"t": [0, 1, nan, 3]}, "t has 1 value not finite (first at index 2: nan); drop"),
        ({"t": [0, 3, 2, 4]}, "t has 1 value earlier than the point before (first at index 2"),
        ({"t": []}, "t has shape (0,)"),
        ({"t": [[0, 1, 2, 3]]}, "t has shape (1, 4)"),
        ({"t": ["x", 1, 2, 3]}, "t is not an array of numbers"),
        ({"brightness": [1, np.inf, 1, 1]}, "brightness has 1 value not finite"),
        ({"brightness": [1, 2, 3]}, "brightness has shape (3,); expected (4,): one per time"),
        ({"error": [0.1, 0, -1, 0.1]}, "error has 2 values <= 0 (first at index 1: 0.0); give pos"),
        ({"error": [0.1, nan, 1, 0.1]}, "error has 1 value not finite"),
        ({"sun": np.zeros((4, 3))}, "sun has 4 values not of length 1"),
        ({"obs": np.full((4, 3), nan)}, "obs has 4 values not of length 1"),
        ({"obs": np.full((4, 3), 1.0)}, "obs has 4 values not of length 1"),
        ({"sun": np.zeros((4, 2))}, "sun has shape (4, 2)"),
        ({"range_km": [1, 2, 0, 3]}, "range_km has 1 value <= 0"),
        ({"range_km": [1, 2, np.inf, 3]}, "range_km has 1 value not finite"),
        ({"exposure_s": [1, 2, -1, 3]}, "exposure_s has 1 value < 0"),
        ({"kind": "luminosity"}, "kind is 'luminosity'; expected one of: flux, mag"),
        ({"frame": "teme"}, "frame is 'teme'; expected one of: icrs, ecliptic-j2000, inertial"),
        ({"curve": [0, 0, 2, 2]}, "curve 1 has no points"),
        ({"curve": [0, 0, -1, 1]}, "curve has 1 value < 0"),
        ({"curve": [0, 0, 10**9, 1]}, "curve has 1 value >= the number of points"),
        ({"curve": [0.0, 0, 1, 1]}, "curve has type float64; expected integers"),
        ({"curve": [0, 1]}, "curve has shape (2,)"),
        ({"free_scale": [True, True]}, "free_scale has shape (2,); expected (1,): one per curve"),
        ({"curve_names": ("a", "b")}, "curve_names has 2 different names for 1 curves"),
        ({"curve": [0, 0, 1, 1], "curve_names": ("a", "a")}, "1 different names for 2 curves"),
        ({"band": ["V"]}, "band has shape (1,)"),
        ({"epoch_jd": nan}, "epoch_jd is nan"),
        ({"extra": {"note": ["a"]}}, "extra column 'note' has shape (1,); expected 4 rows"),
    ],
)
def test_says_what_is_wrong_in_one_line(changes, message):
    with pytest.raises(InputError) as caught:
        LightCurve(**parts(**changes))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_fault_can_be_put_in_the_words_of_a_file():
    with pytest.raises(RowError) as caught:
        LightCurve(**parts(error=[0.1, 0.0, -1.0, -2.0]))
    assert str(caught.value.located("flux_err", "pass.csv, line 43")) == (
        "flux_err has 3 values <= 0 (first in pass.csv, line 43: 0.0); give positive errors, drop "
        "those rows, or set a floor with --error-floor"
    )


def test_geometry_alone_has_no_brightness():
    curve = LightCurve(**parts(brightness=np.full(4, nan), error=None))
    assert curve.geometry_only
