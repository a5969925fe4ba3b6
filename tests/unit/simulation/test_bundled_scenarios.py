"""The demo's light curve is what its scenario gives; run this file to write it anew."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

import lcbayes.simulation.scenarios
from lcbayes.data.read import read
from lcbayes.simulation.scenarios.scenario import load
from lcbayes.simulation.scenarios.viewing import Orbit
from lcbayes.simulation.simulate import simulate

FOLDER = Path(lcbayes.simulation.scenarios.__file__).parent
SEED = 20260415
HEADER = "utc,flux,flux_err,site,site_lat_deg,site_lon_deg,site_height_m"


def observers_file() -> str:
    """The box-wing's light curve as its observers would write it: no directions, only sites."""
    scenario = load("box-wing")
    curve, _ = simulate(scenario, SEED)
    assert isinstance(scenario.geometry, Orbit)
    assert curve.epoch_jd is not None
    assert curve.error is not None
    assert curve.site is not None
    sites = {one.site.name: one.site for one in scenario.geometry.passes}
    ms = round((curve.epoch_jd - 2440587.5) * 86_400_000)
    zero = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(milliseconds=ms)
    rows = [HEADER]
    for t, flux, err, name in zip(curve.t, curve.brightness, curve.error, curve.site, strict=True):
        when = (zero + timedelta(seconds=float(t))).isoformat(timespec="milliseconds")
        site = sites[str(name)]
        rows.append(
            f"{when.removesuffix('+00:00')}Z,{flux:.5e},{err:.5e},{name},"
            f"{site.lat_deg},{site.lon_deg},{site.height_m:g}"
        )
    return "\n".join([*rows, ""])


def test_the_demo_curve_is_its_scenario_s():
    """Read as a user would, with the elements beside it: the same directions and brightness."""
    shipped = read(FOLDER / "box-wing.csv", tle=FOLDER / "box-wing.tle")
    made, truth = simulate(load("box-wing"), SEED)
    assert truth["n_facets"] == 8
    assert set(made.site if made.site is not None else []) == {"Calar Alto", "Zimmerwald"}
    np.testing.assert_allclose(np.diff(shipped.t), np.diff(made.t), rtol=0, atol=1e-4)
    np.testing.assert_allclose(shipped.sun, made.sun, rtol=0, atol=1e-9)
    np.testing.assert_allclose(shipped.obs, made.obs, rtol=0, atol=2e-7)
    assert shipped.range_km == pytest.approx(made.range_km, rel=1e-6)
    assert shipped.brightness == pytest.approx(made.brightness, rel=1e-4, abs=1e-17)
    assert shipped.error == pytest.approx(made.error, rel=1e-5)
    assert list(shipped.site) == list(made.site)  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("name", sorted(lcbayes.simulation.scenarios.bundled()))
def test_bundled_scenarios_simulate(name):
    curve, truth = simulate(load(name), 1)
    assert curve.n_obs >= 100
    assert truth["n_dark_left_out"] == 0
    clean = np.array(truth[curve.kind])
    error = np.asarray(curve.error)
    pulls = (curve.brightness - clean) / error
    assert abs(pulls.std() - 1.0) < 0.2
    assert clean.max() > 10 * np.median(error)


if __name__ == "__main__":
    (FOLDER / "box-wing.csv").write_text(observers_file(), encoding="utf-8")
