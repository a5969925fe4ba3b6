"""The sparse path: where it starts, what is dropped, what is merged, and where it ends."""

from __future__ import annotations

import numpy as np
import pytest

from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.inference import sparse
from lcbayes.modelling import registry
from tests.helpers import small_curves

AXES = np.eye(3)
SD = 0.02


def tilted(degrees: float) -> np.ndarray:
    """x turned towards y."""
    angle = np.deg2rad(degrees)
    return np.array([np.cos(angle), np.sin(angle), 0.0])


def left(vectors, areas=None, sd: float = SD) -> int:
    vectors = np.asarray(vectors, float)
    areas = np.ones(len(vectors)) if areas is None else np.asarray(areas)
    return sparse.remaining(vectors, areas, sd**2 * np.eye(vectors.size))


def test_small_facets_are_dropped():
    """A fiftieth of the whole is the least that counts: 0.2 of 10.2, not 0.2 of 10.3."""
    assert left(AXES, [6.0, 4.0, 0.21]) == 3
    assert left(AXES, [6.0, 4.0, 0.19]) == 2
    assert left(AXES[:1], [3.0]) == 1


def test_normals_within_their_uncertainty_are_one():
    """Each has 0.02 rad, their distance 0.028: two of these are 3.2°."""
    assert left([tilted(0), tilted(3.1)]) == 1
    assert left([tilted(0), tilted(3.4)]) == 2
    assert left([tilted(0), tilted(0)]) == 1
    assert left([tilted(0), 0.9 * tilted(3.1)]) == 1  # 0.9 is the vector's length
    assert left([tilted(0), tilted(3.4)], sd=0.03) == 1


def test_uncertainty_does_not_merge_what_is_far_apart():
    assert left([tilted(0), tilted(29)], sd=1.0) == 1
    assert left([tilted(0), tilted(31)], sd=1.0) == 2
    assert left([tilted(0), tilted(180)], sd=10.0) == 2


def test_small_facets_join_nothing():
    """The small one between two others does not make them one."""
    chain = [tilted(0), tilted(3), tilted(6)]
    assert left(chain) == 1
    assert left(chain, [5.0, 0.01, 5.0]) == 2


def test_errors_that_go_together_do_not_blur_a_distance():
    """Two normals that are uncertain only as a pair are known apart; against each other, not."""
    vectors = np.array([tilted(0), tilted(3)])
    step = np.tile([0.0, 0.05, 0.0], 2)
    together = np.outer(step, step) + 1e-8 * np.eye(6)
    against = np.outer(step * [1, 1, 1, -1, -1, -1], step * [1, 1, 1, -1, -1, -1])
    assert sparse.remaining(vectors, np.ones(2), together) == 2
    assert sparse.remaining(vectors, np.ones(2), against + 1e-8 * np.eye(6)) == 1


@pytest.mark.parametrize("swap", [False, True])
def test_optima_of_a_known_body(swap):
    """Two facets, one of them once more and one tiny: two remain of four at every optimum near the
    best. An optimum that is 11 nats higher does not count, nor does one without a density."""
    problem, data = small_curves.posterior(small_curves.curve(40, 2), n_facets=4, spin="none")
    rng = np.random.default_rng(0)
    far = np.array([0.5, -0.2, 0.8])
    normals = np.stack([*small_curves.NORMALS, small_curves.NORMALS[0], far / np.linalg.norm(far)])
    areas = np.array([3.0, 3.5, 3.0, 1e-3])
    if swap:
        normals, areas = normals[::-1], areas[::-1]

    def row(areas: np.ndarray) -> np.ndarray:
        sites = {
            "normals_base": jnp.asarray(normals + 1e-3 * rng.standard_normal((4, 3))),
            "log_albedo_area": jnp.log(jnp.asarray(areas)),
        }
        return np.asarray(problem.ravel(sites))

    z = np.stack([row(areas), row(areas), row(np.full(4, 2.0)), row(np.full(4, 2.0))])
    sites = ("normals_base", "log_albedo_area")
    found = sparse.path(problem, data, sites, z, np.array([5.0, 3.0, 14.0, np.nan]), 0.5)
    best = float(problem.log_likelihood(jnp.asarray(z[1]), data).sum())
    assert found == sparse.SparsePath(4, 0.5, {2: 1.0}, 2, found.best)
    assert found.best == pytest.approx(best)
    near = sparse.path(problem, data, sites, z, np.array([5.0, 3.0, 12.0, np.nan]), 0.5)
    assert near.shares == {2: pytest.approx(2 / 3), 3: pytest.approx(1 / 3)}


def test_a_path_that_starts_nowhere_is_refused():
    problem, data = small_curves.posterior(small_curves.curve(40, 2), n_facets=2, spin="none")
    z = np.zeros((2, problem.dim))
    with pytest.raises(InputError, match="no start of the sparse path"):
        sparse.path(problem, data, ("normals_base",), z, np.full(2, np.nan), 0.5)


def test_the_path_starts_at_the_fit_that_is_given():
    """Five facets of which two are needed: the starts fit nearly as well as the fit, the end is as
    good, and two facets remain. From draws of the prior the same data mislead the path."""
    curve = small_curves.curve(40, 2)
    entry = registry.find("faceted")
    problem, data = small_curves.posterior(curve, n_facets=2, spin="none")
    sites = {
        "normals_base": jnp.asarray(small_curves.NORMALS),
        "log_albedo_area": jnp.log(jnp.asarray(small_curves.AREAS)),
    }
    fit = sparse.Fit(problem, np.asarray(problem.ravel(sites)))
    larger, _ = small_curves.posterior(curve, n_facets=5, spin="none")
    key = jax.random.key(0)
    rows = sparse.widened(fit, larger, entry.facet_sites, data, key, 3)
    for row in rows:
        body = larger.constrain(jnp.asarray(row), data)
        np.testing.assert_allclose(body["normals"][:2], small_curves.NORMALS, atol=1e-9)
        np.testing.assert_allclose(body["albedo_area"][:2], small_curves.AREAS)
        assert float(body["albedo_area"][2:].sum()) == pytest.approx(0.95)
    found = sparse.follow(entry, {"spin": "none"}, 5, [fit], data, key, 1)
    truth = float(problem.log_likelihood(jnp.asarray(fit.z), data).sum())
    assert found.best > truth - 2.0
    assert found.n_facets == 2
    assert found.sparsity == pytest.approx(50.0 / 9.5**2)


def test_the_weight_costs_fifty_nats():
    assert sparse.weight(9.5) * 9.5**2 == pytest.approx(50.0)
