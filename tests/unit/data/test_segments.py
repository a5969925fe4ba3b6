"""Segments of a light curve: one definition, with the gap as its parameter."""

from __future__ import annotations

import numpy as np
import pytest

from lcbayes.data.segments import NIGHT, PASS, Gap, nights, split


def test_the_limit_of_a_gap():
    steps = np.array([0.0, 10.0, 10.0, 2000.0])
    assert Gap(600.0).limit(steps) == 600.0
    assert Gap(600.0, 100.0).limit(steps) == 1000.0  # repeated times are no steps
    assert Gap(600.0, 100.0, 900.0).limit(steps) == 900.0
    assert Gap(600.0, 100.0).limit(np.zeros(3)) == 600.0


def test_split_by_series_and_gap():
    """In order of series, then time, whatever the order of the points."""
    t = np.array([700.0, 0.0, 5.0, 600.0, 1301.0, 3.0])
    label = np.array([0, 0, 1, 0, 0, 1])
    parts = [rows.tolist() for rows in split(t, label, PASS)]
    assert parts == [[1, 3, 0], [4], [5, 2]]
    assert [rows.tolist() for rows in split(t, label, PASS, 2)] == [[1, 3, 0], [5, 2]]


def test_segments_of_one_instant_are_left_out_with_short_ones():
    t, label = np.zeros(4), np.zeros(4, int)
    assert len(split(t, label)) == 1
    assert split(t, label, PASS, 2) == []


@pytest.mark.parametrize(("gap", "count"), [(PASS, 3), (NIGHT, 2)])
def test_sparse_sampling_is_no_gap_in_a_night(gap, count):
    """Points a minute apart: 40 minutes of silence end a pass, 50 median steps a night."""
    night = 60.0 * np.arange(100.0)
    t = np.concatenate([night, night[-1] + 2400.0 + night, 1e6 + night])
    assert len(split(t, np.zeros(300, int), gap)) == count


def test_nights_come_in_order_of_time():
    t = np.concatenate([1e5 + np.arange(40.0), np.arange(40.0), np.arange(10.0)])
    label = np.repeat([0, 1, 2], [40, 40, 10])
    assert [int(rows[0]) for rows in nights(t, label)] == [40, 0]
