"""The reader of occultation chords."""

from __future__ import annotations

import re

import numpy as np
import pytest

from lcbayes.core.errors import InputError
from lcbayes.data.formats.occultation import LIGHT_KM_S, read_occultations
from tests.helpers import occulting_ellipsoid as known


def text() -> str:
    first = known.event(np.array([-20.0, 3.0]), negative=(40.0,))
    second = known.event(np.array([-10.0, 5.0, 20.0]), start=2454900.0)
    return known.text([first, second])


def test_values_with_their_units(tmp_path):
    path = tmp_path / "a.occ"
    path.write_text(text())
    first, second = read_occultations(path)
    wanted = known.event(np.array([-20.0, 3.0]), negative=(40.0,))
    np.testing.assert_array_equal(first.jd, wanted.jd)
    np.testing.assert_array_equal(first.place_km, wanted.place_km)
    np.testing.assert_array_equal(first.negative, [False, False, True])
    np.testing.assert_array_equal(first.to_earth_km, known.TO_EARTH)
    np.testing.assert_array_equal(first.velocity_km_s, [1.0, 2.0, 3.0])
    assert second.jd.shape == (3, 2)
    # 0.02 s at 5.5 km/s; a Julian date resolves 40 µs, of a chord of ten seconds
    np.testing.assert_allclose(first.error_km, 0.02 * known.SPEED, rtol=2e-5)
    light_time = np.linalg.norm(known.TO_EARTH) / LIGHT_KM_S
    middle = wanted.jd.mean(axis=1)
    np.testing.assert_allclose(86400.0 * (middle - first.body_jd), light_time, atol=1e-3)
    assert light_time == pytest.approx(742.0, abs=2.0)
    np.testing.assert_allclose(first.direction, [np.array([-0.9, 0.4]) / np.hypot(0.9, 0.4)] * 3)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda s: s.replace("2\n", "two\n", 1), "line 1: expected the number of events"),
        (lambda s: s.replace("2\n", "3\n", 1), "ends before the vector from the asteroid"),
        (lambda s: s.replace("2\n", "1\n", 1), "line 9: a line follows the last chord"),
        (lambda s: s.replace("-156000000.0", "1.0 2.0"), "line 2: expected 3 finite numbers"),
        (lambda s: s.replace("-156000000.0 -158000000.0", "1 1"), None),
        (lambda s: s.replace("-156000000.0 -158000000.0 -14000000.0", "1 1 1"), "not that of an"),
        (lambda s: s.replace("0.02", "nan", 1), "line 6: expected 9 finite numbers for a chord"),
        (lambda s: s.replace("0.02", "x", 1), "line 6: a chord: could not convert"),
        (lambda s: s.replace("0.02", "-1", 1), "line 6: a timing error is not positive"),
        (lambda s: s.replace("2454811.8", "54811.8", 1), "line 6: a time is no Julian date"),
        (lambda s: s.replace("2454811.8", "2454911.8", 1), "appearance is not after"),
        (lambda s: s.replace("2454811.8", "2454711.8", 1), "km/s relative to the shadow; give"),
        (lambda s: s.replace(" 3\n", " -1\n"), "fewer than two chords of this event are positive"),
        (lambda s: s.replace("17.27\n3", "17.27\n5"), "line 9: expected 9 finite numbers"),
        (lambda _: "", "is empty"),
    ],
)
def test_a_damaged_file_is_named_in_a_line(tmp_path, change, says):
    path = tmp_path / "a.occ"
    changed = change(text())
    assert changed != text()
    path.write_text(changed)
    if says is None:  # still a valid distance
        assert len(read_occultations(path)) == 2
        return
    with pytest.raises(InputError, match=re.escape(says)) as fault:
        read_occultations(path)
    assert "\n" not in str(fault.value)
