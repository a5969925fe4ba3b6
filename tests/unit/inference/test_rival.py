"""Another body that explains the data: its evidence, its spin, and what the intervals then hold.

Light curves are from a simulator without any code of the package.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import lcbayes
from benchmarks import _asteroids as asteroids
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.inference import rival as rivals
from lcbayes.inference.label_switching import AttitudeOrder
from lcbayes.inference.rival import SPIN, Rival
from lcbayes.inference.start_from import placed
from lcbayes.modelling import registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.results import rivals as said
from lcbayes.results.reasons import reason

OPTIONS = {"n_quadrature": 300, "degree": 4, "n_facets": 100}
ROOT = Path(__file__).parents[3]


@pytest.mark.parametrize(("kind", "seed"), [("binary", 100), ("ellipsoid", 0), ("spot", 3)])
def test_a_contact_binary_is_told_from_convex_bodies(kind, seed, tmp_path, monkeypatch):
    """300 points of 1 %. A convex body has the pole of the binary 9° off, with residuals of 1 %."""
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    from benchmarks.contact_binaries import compared, off_deg

    case, _, found = compared(kind, seed, tmp_path / "curve.lcs", **OPTIONS)
    reasons = [reason(one).text for one in said.findings(found)]
    line = " ".join(said.lines(said.content_of(found).get("rival")))
    if kind == "binary":
        assert found.log_odds > 20.0
        assert off_deg(case, *(found.spin[k][0] for k in SPIN[1:])) < 2.0
        assert len(reasons) == 1
        assert "fit it with --model contact-binary" in reasons[0]
    elif kind == "ellipsoid":
        assert not reasons
        assert min(found.held.values()) > 0.6
        assert "its spin agrees" in line or "which is worse" in line
    else:
        assert found.log_odds == -np.inf
        assert not reasons
        assert "fits much worse" in line


def made(log_odds: float, **spin: float) -> Rival:
    """A rival with a spin near (5 h, 359°, 10°), and what the intervals of a fit hold."""
    rng = np.random.default_rng(2)
    own = {"period_h": 5.0, "pole_lon_deg": 359.0, "pole_lat_deg": 10.0}
    sds = {"period_h": 1e-4, "pole_lon_deg": 2.0, "pole_lat_deg": 1.0}
    draws = {k: (x + sds[k] * rng.standard_normal((4, 500))) for k, x in own.items()}
    draws["pole_lon_deg"] %= 360.0
    theirs = own | spin
    sampled = {k: theirs[k] + 0.5 * sds[k] * rng.standard_normal(400) for k in SPIN}
    sampled["pole_lon_deg"] %= 360.0
    held = rivals._held(sampled, draws, log_odds)
    return Rival("contact-binary", 0, log_odds, 0.01, {k: (theirs[k], sds[k]) for k in SPIN}, held)


def test_longitudes_on_either_side_of_zero_are_near():
    assert made(50.0, pole_lon_deg=360.5).held["pole_lon_deg"] > 0.95
    assert made(50.0, pole_lon_deg=369.0).held["pole_lon_deg"] < 0.01


def test_intervals_hold_what_both_bodies_say():
    """With equal evidence, half of it is that of the fit: 0.45 of an interval of 90 %."""
    far = {"pole_lat_deg": 20.0}
    assert made(0.0, **far).held["pole_lat_deg"] == pytest.approx(0.45)
    assert made(-np.log(9.0), **far).held["pole_lat_deg"] == pytest.approx(0.81)
    assert made(40.0, **far).held["pole_lat_deg"] == pytest.approx(0.0, abs=1e-9)
    assert made(-40.0, **far).held["pole_lat_deg"] == pytest.approx(0.9)


@pytest.mark.parametrize(
    ("log_odds", "spin", "refused"),
    [
        (40.0, {"pole_lat_deg": 13.0}, "the latitude of the pole holds 0 %"),
        (0.0, {"pole_lat_deg": 13.0}, "the latitude of the pole holds 45 %"),
        (0.0, {"period_h": 5.001}, "the period holds 45 %"),
        (-3.0, {"pole_lat_deg": 13.0}, ""),
        (40.0, {"pole_lat_deg": 10.3}, ""),
    ],
)
def test_a_rival_with_another_spin_refuses_the_fit(log_odds, spin, refused):
    found = [reason(one) for one in said.findings(made(log_odds, **spin))]
    assert [one.code for one in found] == ["another-body"] * bool(refused)
    assert refused in " ".join(one.text for one in found)


@pytest.mark.parametrize(
    ("log_odds", "words"),
    [(40.0, "ln evidence +40.0"), (-20.0, "which is worse"), (-np.inf, "fits much worse")],
)
def test_a_line_says_how_the_rival_fits(log_odds, words):
    (line,) = said.lines(said.content_of(made(log_odds)).get("rival"))
    assert words in line


def test_without_a_rival_there_is_nothing_to_say():
    assert said.content_of(None) == {}
    assert list(said.findings(None)) == said.lines(None) == []
    assert not registry.find("faceted").rival


@pytest.mark.parametrize("name", ["convex-grid", "contact-binary"])
def test_rivals_name_each_other_and_start_at_given_spins(name, tmp_path):
    """Every shape starts from every spin."""
    other = registry.find(registry.find(name).rival)
    assert other.rival == name
    case = asteroids.draw_case("ellipsoid", 1)
    asteroids.write(case, tmp_path / "curve.lcs")
    data = Epochs.of(lcbayes.read(tmp_path / "curve.lcs"))
    entry, options = registry.find(name), {"period": case.given_period_h, "n_quadrature": 60}
    problem = Problem(entry.bind(options), data)
    shapes = entry.hook("shapes")
    assert shapes is not None
    spins = [
        {"period_h": case.period_h, "pole_lon_deg": 30.0, "pole_lat_deg": -60.0},
        {"period_h": case.given_period_h, "pole_lon_deg": 200.0, "pole_lat_deg": 10.0},
    ]
    z = placed(spins, jnp.zeros((1, problem.dim)), problem, data, options, shapes)
    count = len(shapes(data, **options))
    assert len(z) == 2 * count
    sites = jax.vmap(lambda row: problem.constrain(row, data))(z)
    for k in SPIN:
        expected = np.repeat([spin[k] for spin in spins], count)
        np.testing.assert_allclose(np.asarray(sites[k]).ravel(), expected, rtol=1e-9)


def test_the_exchange_of_ellipsoids_leaves_the_posterior_as_it_is(tmp_path):
    """Each of the `equivalents` of the model, at a draw of the prior."""
    case = asteroids.draw_case("binary", 1)
    asteroids.write(case, tmp_path / "curve.lcs")
    data, entry = Epochs.of(lcbayes.read(tmp_path / "curve.lcs")), registry.find("contact-binary")
    problem = Problem(entry.bind({"period": case.given_period_h, "n_quadrature": 60}), data)
    alike = entry.hook("equivalents")
    assert alike is not None
    z = np.asarray(problem.prior_draw(jax.random.key(3), data))
    first, second = AttitudeOrder(problem, alike()).images(z[None])[0]
    assert np.abs(first - second).max() > 0.1
    potential = jax.jit(problem.potential)
    values = [float(potential(jnp.asarray(x), data)) for x in (first, second)]
    assert values[1] == pytest.approx(values[0], rel=1e-9)
