"""What ArviZ says of a fit's file is true: one and several solutions, dark epochs, bad chains."""

from __future__ import annotations

import warnings
from pathlib import Path

import arviz as az
import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
import small
import xarray as xr

import lcbayes
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.inference.fit import Mode, Posterior
from lcbayes.inference.loo import loo
from lcbayes.inference.prior_mass import prior_sample
from lcbayes.inference.solutions import Solution
from lcbayes.modelling import likelihood, registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.results.draws import pointwise
from lcbayes.results.posterior import save_tree, tree
from lcbayes.samplers.bridge import LogEvidence

OPTIONS = {"n_facets": 1, "spin": "none"}
CHAINS, DRAWS = 4, 150
WEIGHTS = (0.8, 0.2)
SEED = 4


def opposite(light: lcbayes.LightCurve, n_dark: int) -> lcbayes.LightCurve:
    """The curve with its first points seen from behind the facet: dark, and so constant in every
    draw."""
    sun, obs = light.sun.copy(), light.obs.copy()
    brightness = light.brightness.copy()
    sun[:n_dark], obs[:n_dark] = -small.NORMALS[0], -small.NORMALS[0]
    brightness[:n_dark] = 0.3 * light.error[:n_dark] * np.cos(np.arange(n_dark))
    return small.replace(light, sun=sun, obs=obs, brightness=brightness)


def lit() -> lcbayes.LightCurve:
    """All epochs on the bright side of the facet."""
    n = 30
    rng = np.random.default_rng(8)
    v = small.NORMALS[0] + 0.3 * rng.standard_normal((2, n, 3))
    sun, obs = v / np.linalg.norm(v, axis=-1, keepdims=True)
    return small.curve(n, sun=sun, obs=obs)


def modes(problem: Problem, data: Epochs, n: int, apart: float) -> list[Mode]:
    """Chains of n solutions, Gaussian about the truth and, beyond the first, 20 widths from it;
    ``apart`` is the scatter of the chains' centres in widths."""
    z0 = np.asarray(small.truth(problem, data, 1))
    factor = np.linalg.inv(np.linalg.cholesky(np.asarray(problem.fisher(z0, data)))).T
    rng = np.random.default_rng(1)
    found = []
    for k in range(n):
        length = DRAWS + 50 * k  # the second went on for longer
        y = rng.standard_normal((CHAINS, length, problem.dim))
        y += apart * rng.standard_normal((CHAINS, 1, problem.dim))
        y[..., 0] += 20.0 * k
        energy = 3.0 + rng.standard_normal((CHAINS, length))
        stats = {
            "potential_energy": energy,
            "energy": energy + rng.standard_exponential((CHAINS, length)),
            "diverging": np.zeros((CHAINS, length), bool),
            "accept_prob": rng.uniform(0.7, 1.0, (CHAINS, length)),
            "num_steps": np.full((CHAINS, length), 7),
        }
        mode = Mode(
            Solution(z0, 0.0, 0.0, 1.0, 2),
            z0 + y @ factor.T,
            stats,
            LogEvidence(0.0, 0.1),
            tuning={"step_size": np.linspace(0.4, 0.5, CHAINS)},
        )
        mode.weight = WEIGHTS[k] if n > 1 else 1.0
        found.append(mode)
    return found


def made(n_solutions: int, n_dark: int, apart: float = 0.0) -> xr.DataTree:
    light = opposite(lit(), n_dark) if n_dark else lit()
    problem, data = small.posed(light, **OPTIONS)
    posterior = Posterior(
        problem, data, modes(problem, data, n_solutions, apart), LogEvidence(0.0, 0.1), 1
    )
    entry = registry.find("faceted")
    return tree(posterior, light, entry, entry.check(OPTIONS), SEED)


CASES = [(1, 0), (1, 5), (2, 0), (2, 5)]


@pytest.fixture(scope="module", params=CASES, ids=lambda c: f"{c[0]} solutions, {c[1]} dark")
def written(request, tmp_path_factory) -> tuple[xr.DataTree, xr.DataTree, tuple[int, int]]:
    """A tree, the same read again from its file, and what it holds."""
    found = made(*request.param)
    path: Path = tmp_path_factory.mktemp("file") / "posterior.nc"
    save_tree(found, path)
    with xr.open_datatree(path, engine="h5netcdf") as lazy:
        return found, lazy.load(), request.param


PLAIN = {"var_names": ["albedo_area", "g", "phi"]}
FUNCTIONS = {
    "summary": lambda file: az.summary(file, **PLAIN),
    "rhat": lambda file: az.rhat(file),
    "ess": lambda file: az.ess(file),
    "mcse": lambda file: az.mcse(file),
    "bfmi": lambda file: az.bfmi(file),
    "hdi": lambda file: az.hdi(file),
    "loo": lambda file: az.loo(file, pointwise=True),
    "compare": lambda file: az.compare({"a": file, "b": file}),
    "psense_summary": lambda file: az.psense_summary(file, **PLAIN),
    "extract": lambda file: az.extract(file, num_samples=50, random_seed=1),
    "diagnose": lambda file: az.diagnose(file),
    "plot_trace": lambda file: az.plot_trace(file, **PLAIN),
    "plot_rank": lambda file: az.plot_rank(file, **PLAIN),
    "plot_energy": lambda file: az.plot_energy(file),
    "plot_forest": lambda file: az.plot_forest(file, **PLAIN),
    "plot_ppc_dist": lambda file: az.plot_ppc_dist(file),
    "plot_prior_posterior": lambda file: az.plot_prior_posterior(file, var_names=["g"]),
    "plot_khat": lambda file: az.plot_khat(az.loo(file, pointwise=True)),
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_arviz_reads_the_file(written, name):
    with mpl.rc_context({"backend": "agg"}), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert FUNCTIONS[name](written[1]) is not None
        plt.close("all")
