"""A stabilised satellite as it was seen on many nights."""

import numpy as np
import pytest

import lcbayes
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.data import segments
from lcbayes.data.read import read
from lcbayes.modelling import registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.tasks.predict.brightness import predicted
from tests.helpers.false_alarms import EACH, counts

pytestmark = pytest.mark.real
FILE = "starlink-v1.5-pomenis/pomenis_observations.csv"


def test_places_are_known_and_some_points_are_in_penumbra(data_dir):
    data = Epochs.of(read(data_dir / FILE))
    assert data.orbit.position_km is not None
    assert data.orbit.velocity_km_s is None  # of many satellites in one catalogue
    light = np.asarray(data.sunlight)
    assert light.min() > 1e-3  # all were seen
    assert 100 < np.sum(light < 0.99) < 150  # 24 of them by a bare Earth without air


@pytest.mark.statistical(false_alarm=EACH)
@pytest.mark.slow
def test_one_half_of_pomenis_predicts_the_other(data_dir):
    """Published models leave 0.715 mag with all points fitted. Of 587 points as many as binomial
    are within 90 %."""
    curve = read(data_dir / FILE)
    first = np.random.default_rng(4).permutation(curve.n_obs) < curve.n_obs // 2
    result = lcbayes.fit(curve.select(first), model="stabilised", n_facets=2, seed=4)
    other = curve.select(~first)
    columns, _ = predicted(result.posterior, curve.select(first), other, "stabilised", {})
    assert np.std(other.brightness - columns["mag_mean"]) < 0.64
    inside = (other.brightness > columns["mag_q05"]) & (other.brightness < columns["mag_q95"])
    low, high = counts(inside.size, 0.9)
    assert low <= inside.sum() <= high


SCORE = "starlink-v2mini-score/v2mini.csv"
HELD = {
    "law": "nadir-gimbal-array",
    "facets": "+z,array:+x",
    "noise_law": "mixture",
    "individuals": False,
}
MEANS = {  # of the posterior of all passes, `benchmarks/score.py`
    "log_albedo_area_held": [-0.29, -1.69],
    "r_sum_held": [0.04, 0.68],
    "specular_share_held": [0.77, 0.66],
    "log_nu_held": [-0.87, 2.51],
    "log_sigma": -2.98,
    "log_pass_sd": -1.25,
    "log_pass_drift_sd": -1.73,
    "logit_outlier_share": -2.92,
    "log_outlier_excess": 1.54,
}


def test_the_wrong_match_is_an_outlier_of_the_model(data_dir):
    """All rows in: the pass that lay in the shadow is called one, and few others are."""
    whole = read(data_dir / SCORE, error=0.02)
    curve = whole.select(np.char.endswith(whole.site, "MMT9"))
    data = Epochs.of(curve)
    entry = registry.find("stabilised")
    problem = Problem(entry.bind(entry.check(HELD)), data)
    z = problem.ravel({k: jnp.asarray(v) for k, v in MEANS.items()})
    outlier = np.asarray(jax.jit(problem.constrain)(z, data)["outlier"])
    number = segments.pass_numbers(curve)
    assert number.max() + 1 == 320
    assert curve.range_km is not None
    wrong = curve.range_km > 2300
    assert wrong.sum() == 6
    assert outlier[wrong].min() > 0.999
    assert 5 < len(np.unique(number[outlier > 0.5])) < 40
