"""Models and priors as objects in `lcbayes.fit`, and what is refused."""

from __future__ import annotations

import re
import tomllib

import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest

import lcbayes
from lcbayes.core.errors import InputError
from lcbayes.modelling import likelihood, registry
from lcbayes.models import faceted
from tests.helpers.small_curves import curve as small

SHORT_RUN = {"num_warmup": 60, "num_samples": 60, "num_chains": 2, "num_starts": 4, "seed": 1}


def constant(data, *, level: float = 1.0):
    """A body whose flux does not change."""
    flux = numpyro.sample("flux_at_unit", dist.LogNormal(jnp.log(level), 1.0))
    likelihood.observe(data, jnp.full(data.t.shape, flux))


@pytest.fixture(scope="module")
def flat():
    curve = small(n=20)
    brightness = 4.0 + 0.1 * np.random.default_rng(1).normal(size=20)
    return lcbayes.LightCurve(
        t=curve.t, brightness=brightness, error=np.full(20, 0.1), sun=curve.sun, obs=curve.obs
    )


def test_a_function_is_a_model(flat, tmp_path):
    fit = lcbayes.fit(
        flat, model=constant, level=3.0, out=tmp_path / "fit", report=False, **SHORT_RUN
    )
    mean = fit.posterior["flux_at_unit"].mean().item()
    assert mean == pytest.approx(np.mean(flat.brightness), abs=0.1)
    record = tomllib.loads((tmp_path / "fit" / "run.toml").read_text())
    assert record["options"]["model"] == f"{__name__}.constant"
    assert record["options"]["level"] == 3.0
    assert lcbayes.load(tmp_path / "fit").data.attrs["model"] == f"{__name__}.constant"


def test_the_function_of_a_built_in_model_is_that_model():
    assert registry.find(faceted.model).name == "faceted"


def test_a_prior_is_replaced(flat, tmp_path):
    priors = {"flux_at_unit": dist.LogNormal(np.log(8.0), 1e-3)}
    out = tmp_path / "fit"
    fit = lcbayes.fit(flat, model=constant, priors=priors, out=out, report=False, **SHORT_RUN)
    flux = fit.posterior["flux_at_unit"].mean().item()
    assert 7.5 < flux < 8.5  # the narrow prior wins over the data
    recorded = tomllib.loads((out / "run.toml").read_text())["options"]["priors"]
    assert recorded[0].startswith("flux_at_unit: LogNormal(loc=2.07")
    assert "LogNormal" in fit.data.attrs["assumptions"]


def test_a_prior_of_one_number_holds_for_each_element():
    entry = registry.find("faceted").with_priors({"log_albedo_area": dist.Normal(3.0, 1e-6)})
    from lcbayes.modelling.epochs import Epochs

    data = Epochs.of(small(n=6))
    trace = numpyro.handlers.trace(
        numpyro.handlers.seed(entry.bind({"n_facets": 3, "spin": "none"}), 0)
    ).get_trace(data)
    assert trace["log_albedo_area"]["value"].shape == (3,)
    np.testing.assert_allclose(trace["log_albedo_area"]["value"], 3.0, atol=1e-4)
    assert "n_facets" in entry.options


def twice(data, more):
    likelihood.observe(data, more)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"model": 3}, "--model is 3; expected text"),
        ({"model": twice}, "must take data alone by position"),
        ({"model": constant, "depth": 1}, "has no option 'depth'; available: level"),
        ({"model": constant, "priors": 3}, "priors is of type int; give a mapping"),
        (
            {"model": constant, "priors": {"x": 3}},
            "the prior of 'x' is of type int; give a NumPyro",
        ),
        (
            {"model": constant, "priors": {"x": dist.Normal()}},
            "the model samples no 'x'; its sites: flux_at_unit",
        ),
        (
            {
                "n_facets": 2,
                "spin": "none",
                "priors": {"log_albedo_area": dist.Normal().expand([3])},
            },
            "the prior of 'log_albedo_area' has shape (3,); expected (2,)",
        ),
    ],
)
def test_faults_are_one_line(flat, given, message):
    with pytest.raises(InputError, match=re.escape(message)) as caught:
        lcbayes.fit(flat, **given, **SHORT_RUN)
    assert "\n" not in str(caught.value)


def test_a_fault_in_a_function_names_its_line(flat):
    def broken(data):
        likelihood.observe(data, data.nothing)

    line = broken.__code__.co_firstlineno + 1
    with pytest.raises(InputError, match=f"broken, line {line}: AttributeError"):
        lcbayes.fit(flat, model=broken, **SHORT_RUN)
