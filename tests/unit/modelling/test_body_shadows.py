"""A fit with shadows: the brightness of a body that shades itself, and the guide of its chains."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.progress import Silent
from lcbayes.inference import search
from lcbayes.inference.body_search import turns
from lcbayes.inference.fit import Stages
from lcbayes.modelling import constrained, registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem, compiled, lit_at, shaded, with_lit
from lcbayes.models import body
from lcbayes.physics.bodies import primitives
from lcbayes.physics.bodies.lit import Lit
from lcbayes.samplers.settings import Settings
from lcbayes.simulation.known_bodies.body import Values
from lcbayes.simulation.known_bodies.reader import read_body_text
from tests.helpers import newcomer
from tests.helpers import turning_bodies as turning
from tests.helpers.l_shaped_body import boxes, flux
from tests.helpers.shaded_bar import (
    ALBEDO,
    ARM,
    ATTITUDE,
    OBS,
    OMEGA,
    SUN,
    T,
    bar,
    curve,
    shaded_flux,
)

NAMES = ("r_diff", "r_spec", "nu")
SURFACE: Values = {
    "paint": dict(zip(NAMES, newcomer.PAINT, strict=True)),
    "cells": dict(zip(NAMES, newcomer.CELLS, strict=True)),
    "metal": {"r_diff": newcomer.METAL[0]},
}


def directions(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Random unit vectors to Sun and observer, at phase angles below some 90°."""
    both = np.random.default_rng(5).standard_normal((2, n, 3))
    both[1] += 1.5 * both[0]
    return tuple(both / np.linalg.norm(both, axis=-1, keepdims=True))


def test_brightness_of_a_shaded_stage_is_that_of_rays() -> None:
    known = read_body_text(newcomer.BODY).body
    sun, obs = directions(60)
    flux = np.asarray(known.flux(jnp.asarray(sun), jnp.asarray(obs), SURFACE))
    bare = np.asarray(known.flux(jnp.asarray(sun), jnp.asarray(obs), SURFACE, shadows=False))
    rays = np.array([newcomer.flux(newcomer.pieces(), s, o) for s, o in zip(sun, obs, strict=True)])
    assert np.abs(flux - rays).max() < 4e-3 * rays.max()
    assert np.abs(bare - rays).max() > 0.05 * rays.max()


def test_strips_with_one_shadow_are_as_good_as_single_panels(monkeypatch) -> None:
    sun, obs = map(jnp.asarray, directions(200))
    wide = read_body_text(newcomer.BODY + "# strips\n").body
    monkeypatch.setattr(primitives, "STRIPS", 10**6)
    single = read_body_text(newcomer.BODY + "# single\n").body
    panels = wide.assembly.parts[0].panels
    assert panels.shared == 4
    assert single.assembly.parts[0].panels.shared == 1
    flux, right = (np.asarray(b.flux(sun, obs, SURFACE)) for b in (wide, single))
    assert 0.0 < np.abs(flux - right).max() < 1e-3 * right.max()


def posterior_of_the_bar() -> tuple[Problem, Epochs, np.ndarray]:
    """A posterior of the bar with an arm, its data, and a point."""
    entry, data = registry.find("body"), Epochs.of(curve(shaded_flux(), 30.0))
    options = entry.check({"body": bar(shadows=True), "clock_sd": 0.0, "rate_drift_sd": 0.0})
    problem = Problem(entry.bind(options), data, shading=body.shading(**options))
    return problem, data, np.random.default_rng(2).normal(size=problem.dim)


def test_fixed_shadows_are_the_density_at_their_point_and_similar_nearby() -> None:
    problem, data, z = posterior_of_the_bar()
    lit = lit_at(problem, z, data)
    assert lit is not None
    assert lit.fraction.shape == (T.size, 12)
    held = with_lit(data, lit.fixed)
    assert lit_at(problem, z, held) is None
    potential = compiled(problem.potential)
    assert float(potential(z, held)) == pytest.approx(float(potential(z, data)), rel=1e-12)
    step = 1e-3 * np.random.default_rng(3).normal(size=problem.dim)
    exact, followed = (float(potential(z + step, x) - potential(z, x)) for x in (data, held))
    assert followed != exact
    assert followed == pytest.approx(exact, rel=0.3)


def test_shadows_computed_before_give_the_values_and_derivatives_of_those_in_the_model() -> None:
    """The second problem has no `shading`, so that its programs contain the shadows."""
    problem, data, z = posterior_of_the_bar()
    alone = Problem(problem.model, data)
    assert shaded(problem, z, data).lit is not None
    assert shaded(alone, z, data) is data
    for name in ("potential", "slope", "fisher", "moments", "log_tail"):
        found, right = (
            np.concatenate(
                [np.ravel(x) for x in jax.tree.leaves(compiled(getattr(p, name))(z, data))]
            )
            for p in (problem, alone)
        )
        np.testing.assert_allclose(found, right, rtol=1e-9, atol=1e-9 * np.abs(right).max())
    flat = with_lit(data, Lit(jnp.ones((T.size, 12))))
    slopes = [np.asarray(compiled(problem.slope)(z, x)) for x in (data, flat)]
    assert np.abs(slopes[0] - slopes[1]).max() > 0.1 * np.abs(slopes[0]).max()


def test_shadows_of_draws_are_those_of_each() -> None:
    problem, data, z = posterior_of_the_bar()
    rows = z + 0.1 * np.random.default_rng(4).normal(size=(35, z.size))
    found = constrained.potentials(problem, rows, data)
    right = [float(compiled(problem.potential)(row, data)) for row in rows]
    np.testing.assert_allclose(found, right, rtol=1e-10)
    sites = constrained.constrain_draws(problem, rows[None], data)
    assert "lit_and_seen" not in sites
    one = compiled(problem.constrain)(rows[-1], data)
    np.testing.assert_allclose(sites["omega"][0, -1], one["omega"], rtol=1e-12)


def test_shadows_during_exposures_are_not_those_of_their_middles() -> None:
    problem, data, z = posterior_of_the_bar()
    long = replace(data, exposure_s=jnp.full(T.size, 3.0), has_exposure=True)
    assert shaded(problem, z, long) is long
    assert constrained.lit_of_draws(problem, jnp.asarray(z)[None], long) is None
    held = with_lit(long, lit_at(problem, z, long))
    exact, at_middle = (np.asarray(compiled(problem.flux_at)(z, x)) for x in (long, held))
    assert np.abs(exact - at_middle).max() > 1e-4 * exact.max()


def test_expected_information_is_that_of_differences() -> None:
    """The reflectances are varied while the shadows of the attitude are held."""
    problem, data, z = posterior_of_the_bar()
    moments, h = compiled(problem.moments), 1e-6
    steps = h * np.eye(problem.dim)
    up, down = ([np.asarray(moments(z + s * e, data).mean) for e in steps] for s in (1, -1))
    jacobian = (np.array(up) - np.array(down)) / (2.0 * h * np.asarray(moments(z, data).sd))
    right = jacobian @ jacobian.T + np.asarray(compiled(problem.prior_precision)(z, data))
    result = np.asarray(compiled(problem.fisher)(z, data))
    np.testing.assert_allclose(result, right, rtol=1e-5, atol=1e-6 * np.abs(right).max())


def test_chains_follow_an_expansion_where_a_gradient_is_slow(monkeypatch) -> None:
    for many, name in ((500.0, "guided"), (2000.0, "nuts")):  # of 80 epochs times 12 panels
        monkeypatch.setattr(body, "MANY", many)
        problem, data, z = posterior_of_the_bar()
        stages = Stages.of(
            problem,
            registry.find("body"),
            {"body": bar(shadows=True), "clock_sd": 0.0, "rate_drift_sd": 0.0},
            Settings(),
            None,  # pyright: ignore[reportArgumentType]
            None,  # pyright: ignore[reportArgumentType]
        )
        sampler = stages.sampler(problem, data)
        assert sampler.settings.sampler == name
        if sampler.guide is not None:  # the programs of the chains are compiled before it is known
            shapes, found = jax.eval_shape(sampler.guide, z), sampler.guide(z)
            assert jax.tree.map(lambda x: (x.shape, x.dtype), shapes) == jax.tree.map(
                lambda x: (x.shape, x.dtype), found
            )


def alone(z: np.ndarray) -> np.ndarray:
    """Points (n, D) without further images, (n, 1, D)."""
    return z[:, None]


def test_an_end_that_is_half_a_turn_away_is_put_right(monkeypatch) -> None:
    """Without shadows, a motion half a turn away may fit nearly as well as the true one."""
    moved: list[object] = []

    def counted(*args: Any) -> search.SearchState:
        moved.append(args)
        return advance(*args)

    advance = search.advance
    monkeypatch.setattr(search, "advance", counted)
    problem, data, z = posterior_of_the_bar()
    sites = {k: np.asarray(v) for k, v in compiled(problem.constrain)(z, data).items()}
    unit = np.linalg.norm(sites["omega"]) / abs(sites["rate_unit"])
    middle = Rotation.from_rotvec(float(data.t_middle) * OMEGA) * Rotation.from_matrix(ATTITUDE)
    wrong = Rotation.from_rotvec(np.pi * OMEGA / np.linalg.norm(OMEGA)) * middle
    known = {
        "rate_unit": np.linalg.norm(OMEGA) / unit,
        "attitude_base": wrong.as_quat(scalar_first=True),
    }
    start = {k: sites[k] for k in problem.names} | known | {"paint_r_diff": ALBEDO}
    row = np.asarray(problem.ravel({k: jnp.asarray(v, float) for k, v in start.items()}))
    ends = search.init(row[None])._replace(potential=compiled(problem.potential)(row, data)[None])
    ends = turns.with_fixed_shadows(problem, data, ends, alone, 1, Silent())
    assert len(moved) == turns.HELD + 1  # the other, far above, once
    best = np.asarray(ends.z)[np.argmin(ends.potential)]
    found = np.asarray(compiled(problem.constrain)(jnp.asarray(best), data)["attitude"])
    assert np.degrees(Rotation.from_matrix(found.T @ ATTITUDE).magnitude()) < 5.0


@pytest.mark.slow
def test_attitudes_that_shadows_alone_tell_apart_are_all_tried() -> None:
    """Without shadows, the bar looks the same after half a turn about the axis of its spin."""
    text = bar(shadows=True).replace("[0.3, 1.0, 0.2]", "[0.0, 1.0, 0.0]")
    omega = 0.07 * ATTITUDE @ [0.0, 1.0, 0.0]
    seen = turning.in_body(T, ATTITUDE, omega, SUN, OBS)
    light = curve(ALBEDO * flux(boxes(ARM), *seen, per_side=60), 30.0)
    assert light.error is not None
    noise = light.error * np.random.default_rng(4).standard_normal(T.size)
    light = replace(light, brightness=light.brightness + noise)
    entry, data = registry.find("body"), Epochs.of(light)
    given = {"clock_sd": 0.0, "rate_drift_sd": 0.0, "period": "89-90.5s"}
    options = entry.check({"body": text, **given})
    problem = Problem(entry.bind(options), data, shading=body.shading(**options))
    every = {o.name: o.default for o in entry.options.values()} | options
    ends, _ = body.search(problem, data, every, 2, Silent())
    found = compiled(problem.constrain)(jnp.asarray(ends.z[0]), data)
    turn = Rotation.from_matrix(np.asarray(found["attitude"]).T @ ATTITUDE).magnitude()
    assert np.degrees(turn) < 10.0
