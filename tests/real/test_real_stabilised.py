"""A stabilised satellite as it was seen on many nights."""

import numpy as np
import pytest

import lcbayes
from lcbayes.epochs import Epochs
from lcbayes.io import read
from lcbayes.predict import predict

pytestmark = pytest.mark.real
FILE = "starlink-v1.5-pomenis/pomenis_observations.csv"


def test_places_are_known_and_some_points_are_in_penumbra(data_dir):
    data = Epochs.of(read(data_dir / FILE))
    assert data.orbit.position_km is not None
    assert data.orbit.velocity_km_s is None  # of many satellites in one catalogue
    light = np.asarray(data.sunlight)
    assert light.min() > 1e-3  # all were seen
    assert 100 < np.sum(light < 0.99) < 150  # 24 of them by a bare Earth without air


@pytest.mark.slow
def test_one_half_of_pomenis_predicts_the_other(data_dir):
    """Published models leave 0.715 mag with all points fitted. Of 587 points the share within 90 %
    has a standard error of 1.2 %: 4 of them."""
    curve = read(data_dir / FILE)
    first = np.random.default_rng(4).permutation(curve.n_obs) < curve.n_obs // 2
    found = lcbayes.fit(curve.select(first), "stabilised", n_facets=2, seed=4)
    other = curve.select(~first)
    columns, _ = predict(found.posterior, curve.select(first), other, "stabilised", {})
    assert np.std(other.brightness - columns["mag_mean"]) < 0.64
    inside = (other.brightness > columns["mag_q05"]) & (other.brightness < columns["mag_q95"])
    assert np.mean(inside) == pytest.approx(0.9, abs=0.05)
