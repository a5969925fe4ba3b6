"""A solution that holds next to nothing of the posterior is left out after its first draws."""

from __future__ import annotations

import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from lcbayes.core.checkpoint import Checkpoint
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inference.fit import NEGLIGIBLE, Stages
from lcbayes.inference.label_switching import FacetOrder
from lcbayes.inference.solutions import Solution
from lcbayes.modelling import likelihood, registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.samplers import sampling
from lcbayes.samplers.chains import Whitening
from lcbayes.samplers.settings import NUTS, Settings
from tests.helpers import small_curves
from tests.helpers.heard import Heard

MEAN = 1.0  # of the prior of x, that of the positive solution


def log_evidence(curve: LightCurve, prior_sd: float, sign: float) -> float:
    """ln ∫ p(y | x²) p(x) dx over x of one sign, in SciPy."""

    def log_joint(x: float) -> float:
        fit = norm.logpdf(curve.brightness, x**2, curve.error).sum()
        return float(fit + norm.logpdf(x, MEAN, prior_sd))

    top = sign * np.sqrt(np.mean(curve.brightness))
    peak = log_joint(top)
    value, _ = quad(lambda x: np.exp(log_joint(x) - peak), top - 0.3, top + 0.3, points=[top])
    return peak + float(np.log(value))


@pytest.mark.parametrize(("prior_sd", "sampled"), [(0.24, False), (0.4, True)])
def test_only_a_solution_far_below_the_best_is_left_out(prior_sd, sampled, tmp_path):
    """The light is that of x², so that x and −x fit equally; the prior prefers one of them."""
    some = small_curves.curve()
    t = some.t
    brightness = np.random.default_rng(0).normal(1.0, 0.3, len(t))
    curve = small_curves.of_flux(t, brightness, 0.3, some.sun, some.obs)

    def square(data: Epochs) -> None:
        x = jnp.asarray(numpyro.sample("x", dist.Normal(MEAN, prior_sd)))
        likelihood.observe(data, x**2 * jnp.ones(data.t.shape))

    data = Epochs.of(curve)
    problem = Problem(square, data)
    settings, heard = Settings(NUTS, seed=1), Heard()
    checkpoint = Checkpoint(tmp_path / "chains", {})
    stages = Stages.of(problem, registry.find("faceted"), {}, settings, checkpoint, heard)
    sampler = sampling.Sampler(problem, settings, 1)
    # As a search may give them: equal in evidence, by an approximation that is wrong.
    optima = [Solution(np.array([x]), 0.0, 0.0, 0.0, 1) for x in (1.0, -1.0)]
    groups = [[optimum] for optimum in optima]
    order = FacetOrder(problem, ())
    modes = stages._modes(sampler, order, groups, data, jax.random.key(1))
    exact = [log_evidence(curve, prior_sd, sign) for sign in (1.0, -1.0)]
    assert (exact[1] > exact[0] - NEGLIGIBLE) == sampled
    assert len(modes) == 1 + sampled
    assert ("left out" in " ".join(heard.lines)) != sampled
    for mode, z in zip(modes, exact, strict=False):
        assert mode.log_evidence.value == pytest.approx(z, abs=5 * mode.log_evidence.se + 0.02)
    assert len(list((tmp_path / "chains").glob("mode-1-*"))) == (
        sum(sampler.n_blocks) if sampled else sampler._pilot_blocks
    )


def test_the_evidence_of_a_gaussian():
    """From draws of a correlated Gaussian in 30 dimensions, with an error of √(D/2n)."""
    rng, dim, constant = np.random.default_rng(2), 30, 412.5
    factor = np.tril(rng.normal(size=(dim, dim))) + 3.0 * np.eye(dim)
    draws = rng.standard_normal((4, sampling.BLOCK, dim))
    energy = 0.5 * np.sum(draws**2, axis=2) + constant
    energy[:, : sampling.BLOCK // 2] = 1e6  # not yet there
    exact = np.log(np.diag(factor)).sum() + 0.5 * dim * np.log(2 * np.pi) - constant
    found = sampling._log_evidence({"potential_energy": energy}, Whitening(np.zeros(dim), factor))
    assert found == pytest.approx(exact, abs=5 * np.sqrt(0.5 * dim / 100))
