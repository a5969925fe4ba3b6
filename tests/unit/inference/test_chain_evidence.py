"""Evidence of numbers of facets from chains and bridges, and when particles take over."""

from __future__ import annotations

import numpy as np
import pytest

import lcbayes
from lcbayes.core.jax_setup import jax
from lcbayes.inference import chain_evidence
from lcbayes.modelling import registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from tests.helpers import one_facet_posterior, small_curves

OPTIONS = {"spin": "none", "num_starts": 8, "num_particles": 30, "num_runs": 2, "seed": 1}


@pytest.fixture(scope="module")
def curve():
    return small_curves.curve(16)


@pytest.fixture(scope="module")
def comparison(curve):
    """The comparison by chains, and what the measurement of each number was given."""
    measure, given = chain_evidence.measure, []

    def recorded(*args):
        given.append(args)
        return measure(*args)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(chain_evidence, "measure", recorded)
        result = lcbayes.compare(curve, n_facets=(1, 2), evidence="chains", **OPTIONS)
    return result, given


@pytest.fixture(scope="module")
def compared(comparison):
    return comparison[0]


def test_the_evidence_from_chains_is_that_of_quadrature(compared, curve):
    """One facet, under the prior given that it is seen; the error holds and is small."""
    told = compared.content
    row, centre = told["candidates"][0], np.log(told["area_prior"]["median_m2"])
    assert row["evidence_from"] == "chains"
    assert row["chains_doubted"] == ""
    data = Epochs.of(curve)
    grid = one_facet_posterior.Quadrature.of(data)
    log_area = grid.axes[0]
    ratio = np.exp(0.5 * log_area**2 - 0.5 * (log_area - centre) ** 2)
    exact = grid.log_evidence(data) + np.log(grid.marginal("log_albedo_area") @ ratio)
    assert row["log_evidence_se"] < chain_evidence.MAX_SE
    assert row["log_evidence"] + row["log_prior_mass"] == pytest.approx(exact, abs=0.15)
    assert len(row["log_evidences"]) == OPTIONS["num_runs"]


def test_chains_that_are_doubted_give_way_to_particles(compared):
    """Two facets, of which the data determine one: the chains disagree."""
    row = compared.content["candidates"][1]
    assert row["n_facets"] == 2
    assert row["evidence_from"] == "particles"
    assert "chains disagree" in row["chains_doubted"]
    assert np.isfinite(row["log_evidence"])


def test_uncertain_bridges_are_doubted(comparison, monkeypatch):
    (one,) = (args for args in comparison[1] if args[0].plain.dim == 4)
    monkeypatch.setattr(chain_evidence, "MAX_SE", -1.0)
    with pytest.raises(chain_evidence.Doubtful, match="the bridges are uncertain by"):
        chain_evidence.measure(*one)


def test_a_facet_is_added_to_a_smaller_body(curve):
    data = Epochs.of(curve)
    entry = registry.find("faceted")
    one, two = (Problem(entry.bind({"n_facets": n, "spin": "none"}), data) for n in (1, 2))
    z = one.prior_draw(jax.random.key(1), data)
    rows = chain_evidence.one_more(one, np.asarray(z), two, entry.facet_sites, data, z_key())
    assert rows is not None
    assert rows.shape == (chain_evidence.WITH_ONE_MORE, two.dim)
    body = one.constrain(z, data)
    for row in rows:
        larger = two.constrain(row, data)
        np.testing.assert_allclose(larger["normals"][0], body["normals"][0], atol=1e-12)
        np.testing.assert_allclose(larger["albedo_area"][0], body["albedo_area"][0])
    second = np.array([two.constrain(row, data)["normals"][1] for row in rows])
    assert np.linalg.matrix_rank(second) == 3
    spinning = Problem(entry.bind({"n_facets": 2}), data)
    none = chain_evidence.one_more(one, np.asarray(z), spinning, entry.facet_sites, data, z_key())
    assert none is None


def z_key() -> jax.Array:
    return jax.random.key(7)
