"""Starts with one facet more, and evidences from those of a neighbour; see also test_compare.py."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lcbayes.core.jax_setup import jax
from lcbayes.inference import chain_evidence
from lcbayes.modelling import registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.samplers import smc
from lcbayes.samplers.added_facet import Ratio
from lcbayes.samplers.bridge import LogEvidence
from tests.helpers import small_curves


def test_a_facet_is_added_to_a_smaller_body():
    data = Epochs.of(small_curves.curve(16))
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


def from_chains(by_chain, value, se):
    nothing: Any = SimpleNamespace(log_evidence=None)
    runs = [smc.Result(np.zeros((1, 1)), np.zeros(1), v, [], 1, 0, 0.0) for v in by_chain]
    return chain_evidence.FromChains(nothing, runs, LogEvidence(value, se), "in doubt")


@pytest.mark.parametrize("sign", [1, -1])
def test_an_evidence_follows_from_that_of_a_neighbour(sign):
    known = from_chains([9.9, 10.1], 10.0, 0.03)
    ratio = Ratio(LogEvidence(2.0, 0.04), np.array([2.0, 2.0]))
    found = from_chains([0.0, 0.0], 0.0, 3.0).related(known, ratio, sign)
    assert found is not None
    assert found.log_evidence == pytest.approx((10.0 + 2.0 * sign, 0.05))
    assert found.by_chain == pytest.approx([9.9 + 2.0 * sign, 10.1 + 2.0 * sign])
    assert not found.doubt


@pytest.mark.parametrize(
    "ratio",
    [
        Ratio(LogEvidence(2.0, 0.35), np.array([2.0, 2.0])),
        Ratio(LogEvidence(2.0, 0.01), np.array([1.0, 3.0])),
        Ratio(LogEvidence(2.0, 0.01), np.array([np.nan, 2.0])),
    ],
)
def test_a_ratio_with_a_large_error_is_not_relied_on(ratio):
    known = from_chains([10.0, 10.0], 10.0, 0.03)
    assert from_chains([0.0, 0.0], 0.0, 3.0).related(known, ratio, 1) is None
