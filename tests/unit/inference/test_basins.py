"""Regions of particles and the evidence of each, on a density that is known exactly."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.inference import basins
from lcbayes.inference.basins import Basins
from lcbayes.inference.label_switching import FacetOrder
from lcbayes.inference.solutions import Solution
from lcbayes.results.reasons import reason as sentence
from tests.helpers.false_alarms import EACH, limit, squares

FACETS, COORDINATES = 3, 2
LOG_Z = -7.5
SD = 0.3
# Bodies of three facets with two coordinates each; two facets of the second are all but one, so
# that the orders of its facets overlap.
BODIES = np.array([[[2.0, 0.0], [-2.0, 1.0], [0.0, -3.0]], [[6.0, 6.0], [6.2, 6.0], [9.0, 9.0]]])
WEIGHTS = np.array([0.7, 0.3])


class Mixture:
    """−ln of Z Σ_k w_k N(σ z; body_k, SD²), the mean over all orders σ of the facets."""

    dim = FACETS * COORDINATES
    shading = None

    def unravel(self, z):
        return {"facet": jnp.reshape(z, (FACETS, COORDINATES))}

    def potential(self, z, data):  # noqa: ARG002
        z = jnp.reshape(z, (FACETS, COORDINATES))
        of = jnp.stack([z[np.array(order)] for order in permutations(range(FACETS))])
        square = jnp.sum((of[:, None] - BODIES) ** 2, axis=(-2, -1)) / SD**2
        log_norm = self.dim * np.log(SD * np.sqrt(2 * np.pi)) + np.log(len(of))
        return -LOG_Z - jax.nn.logsumexp(-0.5 * square + np.log(WEIGHTS)) + log_norm

    def fisher(self, z, data):  # noqa: ARG002
        return jnp.eye(self.dim) / SD**2


PROBLEM = Mixture()


def drawn(rng: np.random.Generator, counts: tuple[int, int]) -> np.ndarray:
    """So many points of each body, the facets of each point in an order of its own."""
    which = np.repeat([0, 1], counts)
    z = BODIES[which] + SD * rng.standard_normal((len(which), FACETS, COORDINATES))
    orders = np.argsort(rng.random((len(z), FACETS)), axis=1)
    z = np.take_along_axis(z, orders[..., None], axis=1)
    return rng.permutation(z.reshape(len(z), -1))


@pytest.fixture(scope="module")
def cut() -> Basins:
    order = FacetOrder(PROBLEM, ("facet",))  # type: ignore[arg-type]
    return Basins(PROBLEM, None, [Solution(b.ravel(), 0.0, 0.0, 0.0, 1) for b in BODIES], order)  # type: ignore[arg-type]


def weighed(cut: Basins, z: np.ndarray, path: np.ndarray, n_chains: int, rng) -> basins.Weighed:
    label, rows = cut.place(z)
    return basins.weigh(cut, label, rows, path, n_chains, rng)


@pytest.mark.statistical(false_alarm=EACH)
def test_weights_and_evidence_do_not_hang_on_the_shares_of_the_particles(cut):
    """Particles half and half of bodies that weigh 0.7 and 0.3, on ways that gave any evidence:
    the pulls of the evidence of each body over 60 seeds are standard normal."""
    pulls = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        label, rows = cut.place(drawn(rng, (600, 600)))
        found = cut.evidence(label, rows, len(rows), rng)
        want = LOG_Z + np.log(WEIGHTS)
        pulls += [(found[k].value - want[k]) / found[k].se for k in (0, 1)]
    low, high = squares(len(pulls), comparisons=2)
    assert low < np.sum(np.square(pulls)) < high
    assert abs(np.mean(pulls)) < limit(2) / np.sqrt(len(pulls))


def test_runs_are_weighed_by_their_bridges_not_by_their_counts(cut):
    rng = np.random.default_rng(0)
    z = np.stack([drawn(rng, counts) for counts in ((1000, 200), (600, 600), (400, 800))])
    path = np.array([LOG_Z - 0.8, LOG_Z + 0.3, LOG_Z + 0.6])
    found = weighed(cut, z, path, 1200, rng)
    assert found.reasons == []
    assert found.log_evidence.se < 0.05
    np.testing.assert_allclose(found.log_evidence.value, LOG_Z, atol=0.15)
    np.testing.assert_allclose(found.weight, WEIGHTS, atol=0.05)
    np.testing.assert_allclose(found.by_run, np.tile(WEIGHTS, (3, 1)), atol=0.1)
    np.testing.assert_allclose(found.by_run.sum(axis=1), 1.0)


def test_a_run_that_missed_a_body_is_seen(cut):
    rng = np.random.default_rng(1)
    z = np.stack([drawn(rng, counts) for counts in ((1200, 0), (840, 360))])
    found = weighed(cut, z, np.full(2, LOG_Z), 1200, rng)
    np.testing.assert_allclose(found.by_run[0], [1.0, 0.0])
    assert found.weight_sd[0] > 0.1
    np.testing.assert_allclose(found.log_evidences[0], LOG_Z + np.log(WEIGHTS[0]), atol=0.15)


def test_a_way_that_led_elsewhere_is_told(cut):
    """The particles come with an evidence that is not that of where they are."""
    rng = np.random.default_rng(2)
    z = np.stack([drawn(rng, (840, 360)) for _ in range(3)])
    found = weighed(cut, z, LOG_Z + 4.0 + np.array([-0.2, 0.0, 0.2]), 1200, rng)
    assert any("differs by 4.0 nats" in sentence(reason).text for reason in found.reasons)


def test_too_few_particles_are_counted(cut):
    """Regions too thin to be measured: shares, and the evidence of the ways."""
    rng = np.random.default_rng(3)
    z = np.stack([drawn(rng, (12, 8)), drawn(rng, (10, 10))])
    path = np.array([1.0, 1.0])
    found = weighed(cut, z, path, 20, rng)
    np.testing.assert_allclose(found.weight, [0.55, 0.45])
    np.testing.assert_array_equal(found.log_evidences, path)
    assert found.log_evidence.value == pytest.approx(1.0)


def test_every_order_of_the_facets_has_one_place(cut):
    rng = np.random.default_rng(4)
    z = drawn(rng, (50, 50))
    label, placed = cut.place(z)
    for order in permutations(range(FACETS)):
        again = z.reshape(-1, FACETS, COORDINATES)[:, list(order)].reshape(len(z), -1)
        other, there = cut.place(again)
        np.testing.assert_array_equal(other, label)
        np.testing.assert_array_equal(there, placed)
    np.testing.assert_array_equal(cut.place(placed)[1], placed)


@pytest.mark.parametrize("n", [1, 2, 5, 6])
def test_many_rows_are_matched_as_one_is(n):
    class Problem:
        def unravel(self, z):
            return {"facet": jnp.reshape(z[:-1], (n, 2)), "omega": z[-1:]}

        dim = 2 * n + 1

    order = FacetOrder(Problem(), ("facet",))  # type: ignore[arg-type]
    rng = np.random.default_rng(n)
    z, reference = rng.standard_normal((40, 2 * n + 1)), rng.standard_normal(2 * n + 1)
    want = np.array([order.like(row, reference) for row in z])
    np.testing.assert_array_equal(order.like_all(z, reference), want)
