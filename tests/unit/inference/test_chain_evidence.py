"""Starts with one facet more; the evidence from chains itself is tested in test_compare.py."""

from __future__ import annotations

import numpy as np

from lcbayes.core.jax_setup import jax
from lcbayes.inference import chain_evidence
from lcbayes.modelling import registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
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
