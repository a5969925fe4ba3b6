"""Many satellites of one kind: found together first, then each for itself."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import lcbayes
from lcbayes.core.constants import EARTH_RADIUS_KM
from lcbayes.core.jax_setup import jnp
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inference import solutions
from lcbayes.inference.solutions import Solution
from lcbayes.modelling import registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem, compiled
from tests.helpers.false_alarms import EACH, counts, limit

OPTIONS: dict[str, Any] = {
    "facets": "+z@3,+x@11",
    "reflectance": "lambertian",
    "noise_law": "gaussian",
}
MEMBER_SD, PASS_SD, SIGMA = 0.3, 0.15, 0.05
DAY = 86400.0


def fleet(n: int, n_passes: int = 3, n_points: int = 5, seed: int = 0) -> LightCurve:
    """``n`` satellites at 550 km, each seen in some passes, with all that the model has in it."""
    rng = np.random.default_rng([seed, 1])
    unit = lambda v: v / np.linalg.norm(v, axis=-1, keepdims=True)  # noqa: E731
    total = n * n_passes
    where = np.repeat(np.arange(total), n_points)
    step = np.tile(np.arange(n_points) * 8.0, total)
    start = unit(np.array([0.1, 0.95, 0.3]) + 0.12 * rng.standard_normal((total, 3)))
    ahead = 7.6 * unit(np.cross(start, rng.standard_normal((total, 3))))
    position = (EARTH_RADIUS_KM + 550.0) * start[where] + ahead[where] * step[:, None]
    line = EARTH_RADIUS_KM * unit(np.array([0.1, 0.95, 0.3])) - position
    names = tuple(f"sat {i}" for i in range(n))
    light = LightCurve(
        t=DAY * np.tile(np.repeat(np.arange(n_passes), n_points), n) + step,
        brightness=np.zeros(where.size),
        error=np.full(where.size, 0.01),
        kind="mag",
        sun=np.tile(unit(np.array([1.0, -0.3, 0.0])), (where.size, 1)),
        obs=unit(line),
        range_km=np.linalg.norm(line, axis=1),
        position_km=position,
        curve=np.repeat(np.arange(n), n_passes * n_points),
        curve_names=names,
        free_scale=np.zeros(n, bool),
        band=np.full(where.size, "V"),
        frame="icrs",
    )
    problem, data = problem_of(light, individuals=False)
    z = jnp.zeros(problem.dim)
    mean = np.asarray(problem.constrain(z, data)["expected"])
    return replace(
        light,
        brightness=mean
        + offsets(n, seed)[light.curve]
        + PASS_SD * rng.standard_normal(total)[where]
        + np.hypot(SIGMA, 0.01) * rng.standard_normal(where.size),
    )


def offsets(n: int, seed: int) -> np.ndarray:
    return MEMBER_SD * np.random.default_rng([seed, 0]).standard_normal(n)


def problem_of(light: LightCurve, **more):
    data = Epochs.of(light)
    entry = registry.find("stabilised")
    return Problem(entry.bind(entry.check(OPTIONS | more)), data), data


@pytest.fixture(scope="module")
def refined():
    light = fleet(12)
    whole, data = problem_of(light)
    pooled, _ = problem_of(light, individuals=False)
    start = np.zeros(pooled.dim)
    result = solutions.refined(pooled, whole, data, [Solution(start, 0.0, 0.0, 0.0, 3)])
    return whole, data, result[0]


def test_what_a_simpler_model_lacks_is_put_at_its_most_likely(refined):
    """The spread stays at the median of its prior; along all else the density is at its top."""
    whole, data, result = refined
    sites = whole.constrain(jnp.asarray(result.z), data)
    assert float(sites["member_sd"]) == pytest.approx(0.2)
    slope = np.asarray(compiled(whole.slope)(jnp.asarray(result.z), data))
    metric = np.asarray(compiled(whole.fisher)(jnp.asarray(result.z), data))
    free = np.setdiff1d(np.arange(whole.dim), whole.rows(["log_member_sd"]))
    gain = slope[free] @ np.linalg.solve(metric[np.ix_(free, free)], slope[free])
    assert gain < 0.05  # nats still to be had
    assert np.std(sites["member_offset"]) > 0.1
    assert result.hits == 3


@pytest.mark.statistical(false_alarm=EACH)
@pytest.mark.slow
def test_spreads_and_individuals_are_those_that_were_put_in():
    """48 satellites: three spreads in their posterior sds, as many offsets as binomial within their
    90 % intervals, and the package trusts itself."""
    light = fleet(48, seed=3)
    result = lcbayes.fit(light, model="stabilised", seed=2, **OPTIONS)
    assert result.trusted, result.reasons
    p = result.content["parameters"]
    for name, true in (("member_sd", MEMBER_SD), ("pass_sd", PASS_SD), ("sigma", SIGMA)):
        assert abs(p[name]["mean"] - true) < limit(4) * p[name]["sd"], name
    rows = [p[f"member_offset[{i}]"] for i in range(48)]
    inside = [r["q05"] < true < r["q95"] for r, true in zip(rows, offsets(48, 3), strict=True)]
    assert np.sum(inside) >= counts(48, 0.9, 2)[0]
