"""Every built-in model keeps the contract that a user's file must keep."""

from __future__ import annotations

import inspect

import numpy as np
import pytest

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.modelling import registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem, compiled, prior_draws
from lcbayes.simulation.known_bodies.reader import body_text, read_body_text
from tests.helpers import small_curves

LIGHT = small_curves.curve(24, 2, error=None, free_scale=np.array([True]))
NEEDED = {
    "convex-grid": {"period": 0.02, "n_facets": 60, "degree": 2},
    "contact-binary": {"period": 0.02, "n_quadrature": 100},
    "stabilised": {"law": "inertial"},  # the one that needs no orbit
    "body": {"body": "plate", "spin": "free"},
}
QUICK = ("faceted", "convex-grid")  # of the others their own unit tests remain
OPTIONS = [
    *[
        pytest.param((name, NEEDED.get(name, {})), marks=() if name in QUICK else pytest.mark.slow)
        for name in registry.BUILT_IN
    ],
    ("faceted", {"spin": "none", "sparsity": 0.1, "noise_law": "student-t"}),
    *(
        pytest.param(dear, marks=pytest.mark.slow)
        for dear in (
            ("faceted-brdf", {"reflectance": "cook-torrance", "spin": "none"}),
            ("faceted", {"spin": "torque-free"}),
        )
    ),
]


@pytest.fixture(scope="module", params=OPTIONS, ids=lambda p: " ".join(map(str, p)))
def case(request):
    name, given = request.param
    entry = registry.find(name)
    options = entry.check(given)
    data = Epochs.of(LIGHT)
    return entry, options, data, Problem(entry.bind(options), data)


@pytest.mark.parametrize("name", registry.BUILT_IN)
def test_signature(name):
    entry = registry.find(name)
    assert entry.summary
    assert len(entry.summary) < 90  # a line of `lcbayes models`
    assert inspect.getdoc(entry.model)
    kinds = [p.kind for p in inspect.signature(entry.model).parameters.values()]
    assert kinds.count(inspect.Parameter.POSITIONAL_OR_KEYWORD) == 1
    for option in entry.options.values():
        assert option.type in (bool, int, float, str)
        assert option.required or isinstance(option.default, option.type)
    required = {o.name for o in entry.options.values() if o.required}
    assert required == set(NEEDED.get(name, {})) & required


@pytest.mark.parametrize(
    ("name", "given"),
    [
        *((name, NEEDED.get(name, {})) for name in registry.BUILT_IN),
        ("faceted-brdf", {"reflectance": "cook-torrance", "spin": "none"}),
    ],
)
def test_every_model_has_the_sites_of_the_report_and_a_gradient(name, given):
    """Traced for its shapes, which takes no compilation."""
    entry, data = registry.find(name), Epochs.of(LIGHT)
    problem = Problem(entry.bind(entry.check(given)), data)
    z = jax.eval_shape(problem.prior_draw, jax.random.key(0), data)
    value, slope = jax.eval_shape(jax.value_and_grad(problem.potential), z, data)
    assert value.shape == ()
    assert slope.shape == z.shape == (problem.dim,)
    sites = jax.eval_shape(problem.constrain, z, data)
    assert {"flux", "expected", "scale", "sigma"} <= sites.keys()
    if name == "body":  # the report takes the shape from its file
        materials = read_body_text(body_text(given["body"])).body.materials
        assert {f"{material}_albedo_area" for material in materials} <= sites.keys()
    elif name == "contact-binary":
        assert {"size_ratio", "separation", "axis_ba", "axis_cb"} <= sites.keys()
    else:
        assert "albedo_area" in sites
    assert sites["flux"].shape == data.t.shape


@pytest.fixture(scope="module")
def draws(case):
    """A hundred of the prior of the model."""
    *_, data, problem = case
    return prior_draws(problem, jax.random.split(jax.random.key(1), 100), data)


@pytest.fixture(scope="module")
def density(case, draws):
    """Potential and gradient at up to a hundred points (n, D), by one compiled program."""
    *_, data, problem = case

    @jax.jit
    def run(z, data):
        return jax.lax.map(lambda row: jax.value_and_grad(problem.potential)(row, data), z)

    def at(z):
        n = len(z)
        value, slope = run(draws.at[:n].set(z), data)
        return np.asarray(value)[:n], np.asarray(slope)[:n]

    return at


def test_density_and_gradient_are_finite_at_prior_draws(draws, density):
    value, slope = density(draws)
    assert np.all(np.isfinite(value))
    assert np.all(np.isfinite(slope))


def test_records_what_the_report_knows(case, draws):
    entry, _, data, problem = case
    sites = jax.eval_shape(problem.constrain, draws[2], data)
    assert {"flux", "expected", "scale", "sigma"} <= sites.keys()
    assert any(name.endswith("albedo_area") for name in sites)
    assert sites["flux"].shape == sites["expected"].shape == data.t.shape
    assert set(entry.facet_sites) & set(problem.names) or not entry.facet_sites


def test_facets_have_no_order(case, draws, density):
    """Permuting the sites that the model calls the facets' leaves the posterior unchanged."""
    from lcbayes.inference.label_switching import FacetOrder

    entry, _, _, problem = case
    order = FacetOrder(problem, entry.facet_sites)
    if order.n_facets < 2:
        pytest.skip("its facets have places")
    z = np.asarray(draws[3])
    swapped = order.by_size(z, np.arange(float(order.n_facets)))
    assert not np.array_equal(z, swapped)
    (one, other), _ = density(np.stack([z, swapped]))
    np.testing.assert_allclose(other, one, rtol=1e-12)


def test_starts_are_points_of_the_model(case, density):
    entry, options, data, problem = case
    hook = entry.hook("starts")
    if hook is None:
        pytest.skip("searches from the prior")
    rows = jnp.stack([problem.ravel(s) for s in hook(data, jax.random.key(4), **options)])
    assert np.all(np.isfinite(density(rows)[0]))


def test_coordinates_lead_there_and_back(case, draws):
    """The other coordinates reach the same sites, and differ in density by their Jacobian alone."""
    entry, options, data, problem = case
    hook = entry.hook("coordinates")
    if hook is None:
        pytest.skip("samples in NumPyro's own coordinates")
    other = Problem(entry.bind(options), data, hook(data, **options))
    sites = compiled(problem.constrain)(draws[5], data)
    back = compiled(other.constrain)(other.ravel(sites), data)
    for name in problem.names:
        np.testing.assert_allclose(back[name], sites[name], rtol=1e-6, atol=1e-8)
