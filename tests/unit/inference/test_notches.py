"""A body that shades itself, fitted with facets: an L-shaped one, of rays, against convex ones."""

from __future__ import annotations

import numpy as np
import pytest

from lcbayes.core.jax_setup import jnp
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inference.goodness_of_fit import measure
from lcbayes.inference.misfit_tests import examine
from lcbayes.inference.solutions import optimum
from lcbayes.modelling import registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.results.reasons import why
from tests.helpers.known_bodies import directions
from tests.helpers.l_shaped_body import boxes, flux
from tests.helpers.turning_bodies import lambert

N, SNR, ARM = 200, 80.0, 0.3
RNG = np.random.default_rng(4)
SUN, OBS = directions(RNG, N), directions(RNG, N)
NORMALS = np.concatenate([np.eye(3), -np.eye(3)])
SLANTED = np.array([0.6, -0.48, 0.64])


def light_curve(arm: float, further: float = 0.0) -> LightCurve:
    clean = flux(boxes(arm) if arm else boxes(0.0)[:1], SUN, OBS, per_side=20)
    clean = clean + further * lambert(SUN, OBS, SLANTED)
    error = np.full(N, clean.mean() / SNR)
    return LightCurve(
        t=np.arange(float(N)),
        brightness=clean + error * np.random.default_rng(5).standard_normal(N),
        error=error,
        sun=SUN,
        obs=OBS,
        kind="flux",
        free_scale=np.array([False]),
    )


@pytest.fixture(scope="module")
def problem() -> Problem:
    options = {"n_facets": 6, "spin": "none", "reflectance": "lambertian"}
    return Problem(registry.find("faceted").bind(options), Epochs.of(light_curve(ARM)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arm", "further", "name"), [(ARM, 0.0, "notch"), (0.0, 0.3, "facet"), (0.0, 0.0, "")]
)
def test_two_facets_that_shade_one_another_are_told_from_a_further_facet(
    problem, arm, further, name
):
    light = light_curve(arm, further)
    area = np.array([1.0 + arm, 2.0 + arm, 2.0])
    sites = {
        "normals_base": jnp.asarray(NORMALS),
        "log_albedo_area": jnp.log(jnp.asarray(np.tile(area, 2))),
        "log_level": jnp.zeros(0),
    }
    data = Epochs.of(light)
    z0 = np.asarray(problem.ravel({k: sites[k] for k in problem.names}))
    z, _ = optimum(problem, data, z0, np.arange(problem.dim))
    found = examine(problem, z, data, light)
    if not name:
        assert not found.refused
        return
    assert found.cause is not None
    assert found.cause.name == name
    says = why(measure(problem, data, z[None], found))
    if name == "notch":  # the floor faces +z and the wall +x
        assert "the body shades itself: facets 0 and 2 stand on one another" in says
    else:
        assert "further facet" in says
