"""Light curves of a known body by the flux at a few nodes of each arc."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inference.body_search import cells
from lcbayes.inference.body_search.nodes import Nodes
from lcbayes.inference.body_search.surface import Surface
from lcbayes.inference.spin_search.allowed import Allowed
from lcbayes.inference.spin_search.arcs import Arcs, Points
from lcbayes.modelling.epochs import Epochs
from lcbayes.simulation.known_bodies.reader import body_text, read_body_text
from tests.helpers import small_curves
from tests.helpers import turning_bodies as turning

SPACING = np.deg2rad(6.0)


def arcs_of(starts: tuple[float, ...], other: np.ndarray | None = None) -> Arcs:
    """Passes of 200 s, seen also from where an observer is turned by a matrix."""
    t, sun, obs = turning.geometry(starts, 40, 200.0)
    if other is not None:
        t, sun, obs = np.repeat(t, 2), np.repeat(sun, 2, axis=0), np.repeat(obs, 2, axis=0)
        obs[1::2] = obs[1::2] @ other.T
    rng = np.random.default_rng(5)
    flux, error, which = rng.uniform(1.0, 2.0, t.size), np.full(t.size, 0.1), np.arange(t.size)
    return Arcs.of(Points(t, sun, obs, flux, error, which, which), 0.1, 0.0)


@pytest.mark.parametrize("several", [False, True])
def test_directions_between_nodes_are_nearly_linear(several: bool):
    """Each point lies between two nodes of its own observer, a spacing apart."""
    tilt = np.array([[1.0, 0.0, 0.0], [0.0, 0.8, -0.6], [0.0, 0.6, 0.8]])
    arcs = arcs_of((0.0, 40_000.0), tilt if several else None)
    nodes = Nodes.of(arcs, SPACING)
    inside = np.asarray(arcs.weight) > 0.0
    np.testing.assert_allclose(nodes.share.sum(axis=1), inside, atol=1e-12)
    assert np.all(nodes.share >= 0.0)
    assert nodes.share.shape[1] < 0.4 * inside.sum(axis=1).max()
    for name in ("sun", "obs"):
        linear = np.einsum("anl,ani->ali", nodes.share, getattr(nodes, name))
        missed = np.linalg.norm(linear - np.asarray(getattr(arcs, name)), axis=-1)[inside]
        assert missed.max() < SPACING**2 / 4.0  # the sagitta of an arc is an eighth of its square


def test_points_far_apart_are_nodes_themselves():
    arcs = arcs_of((0.0,))
    nodes = Nodes.of(arcs, 0.0)
    np.testing.assert_array_equal(nodes.share[0], np.eye(nodes.share.shape[1]))


def glinting(snr: float) -> LightCurve:
    """A box with wings on two passes."""
    known = read_body_text(body_text("box-wing")).body
    t, sun, obs = turning.geometry((0.0, 40_000.0), 60, 300.0)
    attitude = np.eye(3)
    inside = turning.in_body(t, attitude, 0.07 * known.flat_axis, sun, obs)
    flux = np.asarray(jax.jit(lambda s, o: known.flux(s, o, shadows=False))(*inside))
    return small_curves.of_flux(t, flux, flux.mean() / snr, sun, obs)


def test_gains_are_those_of_all_points():
    """Gains by nodes are nearly those by all points, for every pole and rate."""
    file, data = read_body_text(body_text("box-wing")), Epochs.of(glinting(30.0))
    surface = Surface.of(file, data.sun, data.obs)
    axis = file.body.flat_axis[None]
    run = cells.MotionSearch.of(data, surface, axis, Allowed(((0.0, 0.1),), omega_sd=0.025))
    whole = replace(run, nodes=Nodes.of(run.arcs, 0.0))
    poles = jnp.asarray(np.concatenate([file.body.flat_axis[None], cells.facets.grid(40)]))
    turn = jnp.asarray(run.turns[0])
    by_nodes, exact = (
        np.asarray(cells._visited(one, poles, turn, one.waves(one.rates))) for one in (run, whole)
    )
    assert run.nodes.share.shape[1] < 0.5 * whole.nodes.share.shape[1]
    missed = np.abs(by_nodes - exact) / exact.max()
    assert missed.max() < 0.05
    assert missed.mean() < 0.01
    assert np.argmax(by_nodes) == np.argmax(exact)
