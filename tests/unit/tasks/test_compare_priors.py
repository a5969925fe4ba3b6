"""Priors that a comparison of numbers of facets takes in place of those of the model."""

import tomllib

import numpy as np
import numpyro.distributions as dist
import pytest

import lcbayes
from lcbayes.core.errors import InputError
from lcbayes.inference.area_prior import area_prior_of
from lcbayes.modelling import registry
from tests.helpers import small_curves

SHORT = {
    "n_facets": (1, 2),
    "spin": "none",
    "evidence": "particles",
    "num_particles": 12,
    "num_runs": 2,
    "num_starts": 8,
}
PRIOR = {"log_albedo_area": dist.Normal(1.5, 0.4)}


def test_a_replaced_prior_of_areas_is_not_centred_by_the_data():
    problem, data = small_curves.posterior(small_curves.curve(16), n_facets=1, spin="none")
    z = np.asarray(small_curves.truth(problem, data, 1))
    entry = registry.find("faceted")
    options = {"spin": "none"}
    assert area_prior_of(entry, options, problem, z, data) is not None
    assert area_prior_of(entry.with_priors(PRIOR), options, problem, z, data) is None


@pytest.mark.slow
def test_a_replaced_prior_is_that_of_the_options(tmp_path):
    """The same normal prior given in two ways leads to the same evidences."""
    curve, out = small_curves.curve(16), tmp_path / "out"
    given = lcbayes.compare(curve, priors=PRIOR, out=out, report=False, **SHORT)
    same = lcbayes.compare(curve, log_area_mean=1.5, log_area_sd=0.4, **SHORT)
    assert given.probability == pytest.approx(same.probability, rel=1e-9)
    assert given.content["area_prior"] is None  # which would change with the data
    recorded = tomllib.loads((out / "run.toml").read_text())["options"]["priors"]
    assert recorded == ["log_albedo_area: Normal(loc=1.5, scale=0.4)"]


def test_priors_are_not_replaced_for_kinds_of_body():
    with pytest.raises(InputError, match="leave out bodies"):
        lcbayes.compare(small_curves.curve(16), bodies=("box-wing", "facets:3"), priors=PRIOR)
