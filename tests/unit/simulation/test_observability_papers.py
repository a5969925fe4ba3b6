"""What the figures of Hinks and Wang show, against the papers and their corrected misprints."""

from __future__ import annotations

import numpy as np
import pytest

from tests.helpers import paper_scripts

hinks, wang = map(paper_scripts.load, ("hinks", "wang"))


def test_best_pair_of_elevations_is_not_at_48_degrees():
    """(41, 56) and its mirror; (48, 48) is 0.05 % below (the paper's fig. 5 has it as the peak)."""
    pair, top = wang.best_pair((35.0, 60.0))
    assert pair == pytest.approx([40.8, 56.2], abs=0.15)
    assert wang.in_plane(*pair[::-1]) == pytest.approx(top, rel=1e-9)
    assert 1.0 - wang.in_plane(48.0, 48.0) / top == pytest.approx(0.0005, abs=5e-5)
    assert wang.best_observer(48.0)[0] == pytest.approx(48.0, abs=0.2)


def test_diffuse_observability_is_that_of_wang_16():
    """|S O′ + S′ O| with both directions in one plane, from (14) by numpy alone."""
    k = 28.0 / (23.0 * np.pi) * wang.R_D * (1.0 - wang.R_S)

    def factor(elevation):
        x = np.sin(np.radians(elevation))
        return (1.0 - (1.0 - x / 2.0) ** 5) * x

    step = 1e-4
    for sun, obs in ((5.0, 80.0), (30.0, 60.0), (90.0, 28.0)):
        ends = [k * factor(sun + s) * factor(obs + s) for s in (step, -step)]
        slope = (ends[0] - ends[1]) / (2.0 * np.radians(step))
        assert wang.in_plane(sun, obs) == pytest.approx(abs(slope), rel=1e-6)


def test_the_ring_is_brightest_at_its_top():
    result = wang.ring()
    assert result["azimuth"] == pytest.approx(180.0, abs=0.05)
    assert result["elevation"] > wang.SPECULAR_SUN + 2.0
    assert result["value"] > result["value below"]


def test_hinks_figures():
    pitch = np.linspace(-40.0, 40.0, 8001)
    cut = hinks.Facet(pitch, np.zeros_like(pitch))
    middle = len(pitch) // 2
    assert np.nanargmin(cut.mag) == middle
    assert cut.slope[middle] == pytest.approx(0.0, abs=1e-9)
    # the slope by attitude is that of the magnitude along the cut
    np.testing.assert_allclose(
        cut.slope[2:-2], np.abs(np.gradient(cut.mag, np.radians(pitch)))[2:-2], rtol=2e-3, atol=0.02
    )
    far = np.abs(pitch) > 15.0
    np.testing.assert_allclose(cut.by["r_spec"][far], 2.5 / np.log(10.0) / 0.5, rtol=1e-6)  # (25)
    np.testing.assert_allclose(cut.by["r_diff"][far], -cut.by["r_spec"][far], rtol=1e-6)
