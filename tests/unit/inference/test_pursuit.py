"""Matching pursuit finds the facets of a light curve, and its last choice is the best there is."""

import numpy as np
import pytest
from scipy.optimize import nnls

from lcbayes.core.jax_setup import jnp
from lcbayes.inference.spin_search.arcs import Arcs, Points
from lcbayes.inference.spin_search.pursuit import pursued, pursuit
from lcbayes.inference.spin_search.series import frame
from lcbayes.physics.bodies import facets
from tests.helpers import turning_facets

N = 4


@pytest.mark.parametrize("seed", range(5))
def test_the_last_facet_is_where_least_squares_puts_it(seed):
    """Against every other place for that facet, with areas of non-negative least squares."""
    rng = np.random.default_rng(seed)
    columns = np.abs(rng.standard_normal((40, 60))).cumsum(axis=0) % 3.0
    white = columns[:, :7] @ rng.uniform(0.1, 1.0, 7) + 0.3 * rng.standard_normal(40)
    chosen, areas = pursuit(jnp.asarray(columns), jnp.asarray(white), N)
    chosen, areas = np.asarray(chosen), np.asarray(areas)
    assert len(set(chosen)) == N

    def misfit(rows):
        return nnls(columns[:, rows], white)[1]

    found = misfit(chosen)
    assert np.linalg.norm(columns[:, chosen] @ areas - white) < 1.02 * found
    others = [misfit([*chosen[:-1], i]) for i in range(60) if i not in chosen]
    assert found <= min(others) * (1.0 + 1e-6)


def test_data_of_some_columns_give_these_columns():
    rng = np.random.default_rng(11)
    columns = rng.uniform(0.0, 1.0, (80, 200))
    rows = np.array([3, 50, 120, 170])
    areas = np.array([2.0, 1.0, 0.8, 1.4])
    chosen, found = pursuit(jnp.asarray(columns), jnp.asarray(columns[:, rows] @ areas), N)
    order = np.argsort(chosen)
    np.testing.assert_array_equal(np.asarray(chosen)[order], rows)
    np.testing.assert_allclose(np.asarray(found)[order], areas, rtol=1e-3)


@pytest.mark.parametrize("seed", range(3))
def test_a_given_column_stays_and_the_others_are_chosen_for_it(seed):
    """The last choice is the best there is beside the given column, even if that is of no use."""
    rng = np.random.default_rng(seed)
    columns = rng.uniform(0.0, 1.0, (40, 60))
    white = columns[:, [3, 20, 40]] @ np.array([2.0, 1.0, 0.7]) + columns[:, 8] * 0.1
    for first in (8, 50):
        chosen, _ = pursuit(jnp.asarray(columns), jnp.asarray(white), N, jnp.asarray(first))
        chosen = [int(i) for i in chosen]
        assert chosen[0] == first
        found = nnls(columns[:, chosen], white)[1]
        others = [nnls(columns[:, [*chosen[:-1], i]], white)[1] for i in range(60)]
        assert found <= min(others) * (1.0 + 1e-6) + 1e-9
    alone, area = pursuit(jnp.asarray(columns), jnp.asarray(white), 1, jnp.asarray(8))
    assert alone[0] == 8
    assert area[0] == pytest.approx(columns[:, 8] @ white / (columns[:, 8] @ columns[:, 8]), 1e-5)


def test_facets_of_a_turning_body_are_found():
    """A body simulated in NumPy, at its own spin: normals in the axes of the pole."""
    t = np.linspace(0.0, 400.0, 90)
    omega = np.array([0.03, -0.02, 0.05])
    pole, rate = turning_facets.unit(omega), float(np.linalg.norm(omega))
    places = facets.grid(300)
    axes = np.asarray(frame(jnp.asarray(pole)))
    rows = np.array([20, 110])
    normals, areas = places[rows] @ axes.T, np.array([1.0, 2.0])
    sun = np.broadcast_to(turning_facets.unit(np.array([1.0, 0.3, 0.2])), (90, 3))
    obs = turning_facets.unit(np.array([0.5, -0.6, 0.5]) + t[:, None] * [-0.002, 0.004, 0.0])
    seen = [turning_facets.in_body_axes(v, t, omega) for v in (sun, obs)]
    mu0, mu = turning_facets.cosines(seen[0], seen[1], normals)
    flux = turning_facets.flux(mu0, mu, areas)
    points = Points(t, sun, obs, flux, np.full(90, 1e-4), np.zeros(90, int), np.arange(90))
    arcs = Arcs.whole(points, 0.0)
    middle = 0.5 * (t[0] + t[-1])
    rates = np.array([rate, 1.3 * rate])
    motion = np.tile(pole, (2, 1)), rates, rates[:, None] * middle
    fit = pursued(arcs, motion, "lambertian", places, 2, 1)
    order = np.argsort(fit.rows[0, 0])
    np.testing.assert_array_equal(fit.rows[0, 0][order], rows)
    np.testing.assert_allclose(fit.areas[0, 0][order], areas, rtol=0.01)
    # at the rate of the body nothing is left, and at another rate what NumPy finds
    assert fit.chi2[0, 0] < 1e-6 * fit.chi2[1, 0]
    turned = [turning_facets.in_body_axes(v, t, 1.3 * omega) for v in (sun, obs)]
    mu0, mu = turning_facets.cosines(turned[0], turned[1], places[fit.rows[1, 0]] @ axes.T)
    left = (flux - turning_facets.flux(mu0, mu, fit.areas[1, 0])) / 1e-4
    np.testing.assert_allclose(fit.chi2[1, 0], left @ left, rtol=1e-6)


def test_a_facet_that_is_given_stays():
    t = np.linspace(0.0, 60.0, 30)
    sun = np.broadcast_to([1.0, 0.0, 0.0], (30, 3))
    flux = 1.0 + 0.1 * np.sin(t)
    points = Points(t, sun, sun, flux, np.full(30, 0.01), np.zeros(30, int), np.arange(30))
    motion = np.array([[0.0, 0.0, 1.0]] * 3), np.full(3, 0.1), np.zeros((3, 1))
    first = np.array([[4], [11], [30]])
    arcs, places = Arcs.whole(points, 0.0), facets.grid(50)
    fit = pursued(arcs, motion, "lambertian", places, 3, 2, first=first)
    np.testing.assert_array_equal(fit.rows[:, 1, :1], first)
    alone = pursued(arcs, motion, "lambertian", places, 3, 2)
    np.testing.assert_array_equal(fit.rows[:, :1], alone.rows)  # the other body is free of it
