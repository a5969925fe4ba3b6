"""What a fit knows, for a plan: targets and factors at its draws, against finite differences."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.simulation.observability.targets import of_sites
from lcbayes.simulation.scenarios import scenario
from lcbayes.simulation.simulate import simulate
from lcbayes.tasks.observability import known
from lcbayes.tasks.predict.brightness import Predictor, noise_free
from lcbayes.tasks.predict.run import Fitted

NORMALS = np.array([[1.0, 0.0, 0.0], [0.0, 0.6, 0.8]])


def sites(**change):
    result = {
        "omega": np.array([0.0, 0.0, 0.02]),
        "normals": NORMALS,
        "albedo_area": np.array([2.0, 3.0]),
    }
    return {k: jnp.asarray(v) for k, v in (result | change).items()}


def test_targets_move_as_what_they_name():
    step = 1e-4
    one, first = np.zeros((2, 2, 3))
    one[1, 0] = first[0, 1] = step
    for name, moved, by, unit in (
        ("pole", {"omega": [0.02 * step, 0.0, 0.02]}, np.degrees(step), "deg"),
        (
            "normal:1",
            {"normals": NORMALS + one},
            np.degrees(step),
            "deg",
        ),
        (
            "normals",
            {"normals": NORMALS + first},
            np.degrees(step),
            "deg",
        ),
        ("spin", {"omega": [step, 0.0, 0.02]}, step, "rad/s"),
        ("areas", {"albedo_area": [2.0 * np.exp(step), 3.0]}, step, "1"),
        ("all", {"omega": [step, 0.0, 0.02]}, step, ""),
        ("albedo_area", {"albedo_area": [2.0, 3.0 + step]}, step, ""),
    ):
        ((key, value),) = moved.items()
        slope = jax.jacfwd(lambda x, name=name, key=key: of_sites(sites(**{key: x}), name)[0])
        change = np.tensordot(slope(sites()[key]), np.asarray(value) - sites()[key], np.ndim(value))
        assert of_sites(sites(), name)[1] == unit
        assert np.linalg.norm(change) == pytest.approx(by, rel=1e-3)
    lonlat = {"pole_lon": jnp.asarray(0.3), "pole_lat": jnp.asarray(1.0)}
    turn = jax.jacfwd(lambda lon: of_sites(lonlat | {"pole_lon": lon}, "pole")[0])(0.3)
    assert np.linalg.norm(turn) == pytest.approx(np.degrees(np.cos(1.0)))
    with pytest.raises(InputError, match="target 'normal:7' is not in the posterior"):
        of_sites(sites(), "normal:7")


def test_roots_are_of_the_inverse_whatever_the_units():
    rng = np.random.default_rng(1)
    a = rng.standard_normal((3, 6, 4)) * [1e6, 1.0, 1e-6, 1.0]
    information = np.swapaxes(a, 1, 2) @ a
    root = known.roots(information)
    product = information @ root @ np.swapaxes(root, 1, 2)
    scale = np.array([1e6, 1.0, 1e-6, 1.0])
    np.testing.assert_allclose(
        product * scale / scale[:, None], np.broadcast_to(np.eye(4), (3, 4, 4)), atol=1e-6
    )


@pytest.fixture(scope="module")
def fitted():
    """A curve of one facet, and draws near its truth as a fit has them."""
    curve, truth = simulate(scenario.load("one-facet"), 1)
    rng = np.random.default_rng(2)
    normal = truth["facets"][0]["normal"] + 1e-3 * rng.standard_normal((1, 4, 1, 3))
    area = np.log(10.0) + 1e-3 * rng.standard_normal((1, 4, 1))
    by = ("chain", "draw")
    draws = {"normals_base": ((*by, "f", "x"), normal), "log_albedo_area": ((*by, "f"), area)}
    return curve, xr.Dataset(draws)


@pytest.mark.slow
def test_factors_are_those_of_finite_differences(fitted):
    curve, draws = fitted
    options = {"n_facets": 1, "spin": "none"}
    ready = Predictor.of(draws, curve, curve, "faceted", options, most=4)
    sd = np.full(curve.n_obs, 0.1)
    factor, rows, unit = known.at_draws(ready, curve, curve, sd, "normal:0")
    assert unit == "deg"
    assert factor.shape[:2] == (4, curve.n_obs)
    # the information on brightness and target, through what a draw's own sites say
    problem, h = ready.problem, 1e-6
    for k in range(4):
        at = {name: jnp.asarray(v[k]) for name, v in ready.sites.items()}
        z = np.asarray(problem.ravel(at))

        def mean(z):
            s = problem.constrain(jnp.asarray(z), ready.data)
            moved = draws.isel(draw=[0]).copy()
            for name in ready.sites:
                moved[name] = moved[name].copy(data=np.asarray(s[name])[None, None])
            flux, *_ = noise_free(moved, curve, curve, "faceted", options)
            return flux[0], np.asarray(s["normals"][0])

        ends = [(mean(z + e), mean(z - e)) for e in h * np.eye(len(z))]
        slope = np.array([(up[0] - down[0]) / (2 * h) for up, down in ends]).T / 0.1
        turn = np.degrees(np.array([(up[1] - down[1]) / (2 * h) for up, down in ends]).T)
        information = slope.T @ slope + np.asarray(
            problem.prior_precision(jnp.asarray(z), ready.data)
        )
        covariance = np.linalg.inv(information)
        np.testing.assert_allclose(
            factor[k] @ factor[k].T, slope @ covariance @ slope.T, rtol=1e-4, atol=1e-6
        )
        spread = np.trace(turn @ covariance @ turn.T)
        assert np.sum(rows[k] ** 2) == pytest.approx(spread, rel=1e-4)


def test_a_mixture_is_in_shares_of_the_error_of_each_part(fitted):
    """Directions, zero across themselves by construction, count as much as areas: each has 1."""
    curve, draws = fitted
    options = {"n_facets": 1, "spin": "none"}
    few = curve.select(np.arange(12))
    ready = Predictor.of(draws, curve, few, "faceted", options, most=4)
    _, rows, unit = known.at_draws(ready, curve, few, np.full(12, 0.1), "all")
    assert unit == "1"
    assert rows.shape[1] == 3
    np.testing.assert_allclose(np.mean(np.sum(rows**2, axis=2), axis=0), 1.0, rtol=1e-9)


def test_a_fit_without_a_known_brightness_cannot_plan(fitted, monkeypatch):
    curve, draws = fitted
    fit = Fitted(draws, curve, "faceted", {}, [])
    monkeypatch.setattr(known, "load_fit", lambda *_: fit)
    unknown = SimpleNamespace(own_level=np.array([True]))
    monkeypatch.setattr(known.predict.Predictor, "of", lambda *_, **__: unknown)
    with pytest.raises(InputError, match="has curves of unknown scale only"):
        known.from_fit("fit", SimpleNamespace(curve=curve), "pole")  # pyright: ignore[reportArgumentType]
