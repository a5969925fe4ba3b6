"""A spent Ariane stage whose brightness repeats with 44.33 s, half of which nearly does."""

from __future__ import annotations

import numpy as np
import pytest

from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.spin import estimate


@pytest.mark.parametrize("binned", [1, 5, 10])
@pytest.mark.parametrize("stretch", [1, 2])
def test_the_ariane_stage_repeats_with_44_33_s(data_dir, stretch, binned):
    """Raw 10 Hz magnitudes and their means, either stretch alone; Sun and observer at rest."""
    path = data_dir / f"ariane5-rocket-body/28904_2023-03-23_100ms_{stretch}.tdm"
    rows = [x.split("=")[1].split() for x in path.read_text().splitlines() if x.startswith("MAG ")]
    when = np.array([np.datetime64(stamp) for stamp, _ in rows])
    t, mag = (when - when[0]) / np.timedelta64(1, "s"), np.array([float(m) for _, m in rows])
    t, mag = t[np.isfinite(mag)], mag[np.isfinite(mag)]
    n = t.size // binned * binned
    t, flux = (x[:n].reshape(-1, binned).mean(axis=1) for x in (t, 10 ** (-0.4 * mag)))
    still = np.tile([0.6, 0.0, 0.8], (t.size, 1))
    curve = LightCurve(t=t, brightness=flux, error=None, sun=still, obs=still[:, ::-1])
    result = estimate(curve, n_shuffles=99)
    assert {r.code for r in result.reasons} <= {"constant-synodic-period", "unsteady-harmonics"}
    assert result.mean is not None
    assert result.mean.period == pytest.approx(44.33, abs=0.03)
    assert 0.002 < result.mean.period_error < 0.02
