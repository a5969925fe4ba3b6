"""What ArviZ says of a fit's file is true: one and several solutions, dark epochs, bad chains."""

from __future__ import annotations

import warnings
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import arviz as az
import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
import xarray as xr
from numpyro.infer.util import log_density

import lcbayes
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.inference.fit import Mode, Posterior
from lcbayes.inference.loo import loo
from lcbayes.inference.prior_mass import prior_sample
from lcbayes.inference.solutions import Solution
from lcbayes.modelling import likelihood, registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.modelling.variables import unit
from lcbayes.results.draws import pointwise
from lcbayes.results.posterior import save_tree, tree
from lcbayes.samplers.bridge import LogEvidence
from tests.helpers import small_curves

OPTIONS = {"n_facets": 1, "spin": "none"}
CHAINS, DRAWS = 4, 150
WEIGHTS = (0.8, 0.2)
SEED = 4


def opposite(light: lcbayes.LightCurve, n_dark: int) -> lcbayes.LightCurve:
    """The curve with its first points seen from behind the facet: dark, and so constant in every
    draw."""
    sun, obs = light.sun.copy(), light.obs.copy()
    brightness = light.brightness.copy()
    assert light.error is not None
    sun[:n_dark], obs[:n_dark] = -small_curves.NORMALS[0], -small_curves.NORMALS[0]
    brightness[:n_dark] = 0.3 * light.error[:n_dark] * np.cos(np.arange(n_dark))
    return replace(light, sun=sun, obs=obs, brightness=brightness)


def lit() -> lcbayes.LightCurve:
    """All epochs on the bright side of the facet."""
    n = 30
    rng = np.random.default_rng(8)
    v = small_curves.NORMALS[0] + 0.3 * rng.standard_normal((2, n, 3))
    sun, obs = v / np.linalg.norm(v, axis=-1, keepdims=True)
    return small_curves.curve(n, sun=sun, obs=obs)


def modes(problem: Problem, data: Epochs, n: int, apart: float) -> list[Mode]:
    """Chains of n solutions, Gaussian about the truth and, beyond the first, 6 widths from it;
    ``apart`` is the scatter of the chains' centres in widths."""
    z0 = np.asarray(small_curves.truth(problem, data, 1))
    factor = np.linalg.inv(np.linalg.cholesky(np.asarray(problem.fisher(jnp.asarray(z0), data)))).T
    rng = np.random.default_rng(1)
    result = []
    for k in range(n):
        length = DRAWS + 50 * k  # the second went on for longer
        y = rng.standard_normal((CHAINS, length, problem.dim))
        y += apart * rng.standard_normal((CHAINS, 1, problem.dim))
        y[..., 0] += 6.0 * k
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
            tuning={
                "step_size": np.linspace(0.4, 0.5, CHAINS),
                "inverse_mass_matrix": np.tile(factor @ factor.T, (CHAINS, 1, 1)),
            },
        )
        mode.weight = WEIGHTS[k] if n > 1 else 1.0
        result.append(mode)
    return result


PROBLEM = small_curves.posterior(lit(), **OPTIONS)[0]  # one, that what is compiled serves all


@cache
def made(n_solutions: int, n_dark: int, apart: float = 0.0) -> xr.DataTree:
    light = opposite(lit(), n_dark) if n_dark else lit()
    problem, data = PROBLEM, Epochs.of(light)
    posterior = Posterior(
        problem, data, modes(problem, data, n_solutions, apart), LogEvidence(0.0, 0.1), 1
    )
    entry = registry.find("faceted")
    return tree(posterior, light, entry, entry.check(OPTIONS), SEED)


CASES = [
    (1, 0),
    pytest.param((1, 5), marks=pytest.mark.slow),
    pytest.param((2, 0), marks=pytest.mark.slow),
    (2, 5),
]


@pytest.fixture(scope="module", params=CASES, ids=lambda c: f"{c[0]} solutions, {c[1]} dark")
def written(request, tmp_path_factory) -> tuple[xr.DataTree, xr.DataTree, tuple[int, int]]:
    """A tree, the same read again from its file, and what it holds."""
    result = made(*request.param)
    path: Path = tmp_path_factory.mktemp("file") / "posterior.nc"
    save_tree(result, path)
    with xr.open_datatree(path, engine="h5netcdf") as lazy:
        return result, lazy.load(), request.param


PLAIN: dict[str, Any] = {"var_names": ["albedo_area", "g", "phi"]}
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


def test_chains_are_stacked_as_sampled_and_say_what_they_are_worth(written):
    result, file, (n, _) = written
    posterior = file["posterior"]
    assert dict(posterior["g"].sizes) == {"chain": n * CHAINS, "draw": DRAWS, "facet": 1}
    for k in range(n):
        whole = file[f"modes/{k}/posterior/g"].to_numpy()
        assert whole.shape == (CHAINS, DRAWS + 50 * k, 1)
        here = posterior["g"].to_numpy()[posterior["solution"].to_numpy() == k]
        np.testing.assert_array_equal(here, whole[:, :DRAWS])
    weight = (1.0,) if n == 1 else WEIGHTS
    np.testing.assert_allclose(posterior["weight"], np.repeat(np.divide(weight, CHAINS), CHAINS))
    for group in ("sample_stats", "log_prior", "log_likelihood", "posterior_predictive"):
        for name in ("chain", "draw", "solution", "weight"):
            np.testing.assert_array_equal(file[group].coords[name], posterior.coords[name])
    stats = file["sample_stats"]
    np.testing.assert_allclose(stats.attrs["step_size"], np.tile(np.linspace(0.4, 0.5, 4), n))
    np.testing.assert_allclose(stats.attrs["trajectory_length"], 7 * stats.attrs["step_size"])
    assert result["posterior"].equals(posterior)


def test_weighted_draws_have_the_weights_and_belong_together(written):
    result, _, (n, _) = written
    draws = lcbayes.weighted_draws(result, seed=2)
    solution = draws["posterior"]["solution"].to_numpy()
    total = CHAINS * DRAWS
    assert np.bincount(solution).tolist() == ([total] if n == 1 else [480, 120])
    alone = lcbayes.weighted_draws(result["posterior"].to_dataset(), 100, seed=2)
    assert np.bincount(alone["solution"]).tolist() == ([100] if n == 1 else [80, 20])
    if n == 2:
        assert 0 < solution[:40].sum() < 40  # every stretch holds both
    light = lcbayes.load_light_curve(result)
    problem, data = PROBLEM, Epochs.of(light)
    for i in (0, 77, total - 1):
        row = draws["posterior"].to_dataset().isel(chain=0, draw=i)
        z = problem.ravel({k: jnp.asarray(row[k].to_numpy()) for k in problem.names})
        want = problem.log_likelihood(z, data)
        np.testing.assert_allclose(pointwise(draws)[0, i], want, rtol=1e-9, atol=1e-9)


def test_loo_is_ours_with_and_without_dark_epochs(written):
    result, file, (_, n_dark) = written
    draws = lcbayes.weighted_draws(file, seed=0)
    every = np.asarray(pointwise(lcbayes.weighted_draws(result)))[0]
    ours = float(loo(every).elpd.sum())
    attrs = file["log_likelihood"].attrs
    assert attrs["elpd_loo"] == pytest.approx(ours, abs=1e-9)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of large Pareto k, which ours has as well
        theirs: Any = az.loo(draws, pointwise=True)
    assert theirs.elpd + attrs["elpd_loo_dark"] == pytest.approx(ours, abs=1e-3)
    assert file["log_likelihood"].sizes["time"] == 30 - n_dark
    whole = np.sort(np.r_[file["log_likelihood"]["time"], np.arange(n_dark)])
    np.testing.assert_array_equal(whole, np.arange(30))
    if n_dark:
        assert file["log_likelihood_dark"]["dark_time"].to_numpy().tolist() == list(range(n_dark))
        together = xr.DataTree.from_dict(
            {
                "posterior": draws["posterior"].to_dataset(),
                "log_likelihood": xr.Dataset({"brightness": pointwise(draws)}),
            }
        )
        with pytest.raises(ValueError, match="All tail values are the same"):
            az.loo(together)
    pit = az.loo_pit(file.sel(time=file["log_likelihood"]["time"]))
    assert pit["brightness"].sizes["time"] == 30 - n_dark


def test_chains_that_disagree_look_bad():
    """Also where a shuffle of their draws would hide it."""
    good, bad, two = (az.rhat(made(n, 0, apart)) for n, apart in ((1, 0.0), (1, 3.0), (2, 0.0)))
    worst = [max(float(tree[k].max()) for k in ("albedo_area", "g")) for tree in (good, bad, two)]
    assert worst[0] < 1.02
    assert worst[1] > 1.5
    assert worst[2] > 1.5
    effective = az.ess(made(1, 0, 3.0), var_names=["g"])  # of 600 draws
    assert float(effective["g"].max()) < 30


def test_log_prior_and_likelihood_are_those_of_numpyro(written):
    """Σ ln p over sites and factors, and the likelihood, make up NumPyro's joint density."""
    result, _, _ = written
    light = lcbayes.load_light_curve(result)
    problem, data = PROBLEM, Epochs.of(light)
    row = result["posterior"].to_dataset().isel(chain=0, draw=3)
    sites = {k: jnp.asarray(row[k].to_numpy()) for k in problem.names}
    joint = log_density(problem.model, (data,), {}, sites)[0]
    prior = result["log_prior"].to_dataset().isel(chain=0, draw=3)
    assert set(prior.data_vars) == {*problem.names, "factors"}
    total = sum(float(v) for v in prior.data_vars.values()) + float(pointwise(result)[0, 3].sum())
    assert total == pytest.approx(float(joint), abs=1e-8)


def narrowed(by: float):
    def model(data):
        x = jnp.asarray(numpyro.sample("x", dist.Normal()))
        numpyro.factor("narrow", -by * x**2)
        likelihood.observe(data, x * jnp.ones_like(data.t))

    data = Epochs.of(small_curves.curve(10))
    return Problem(model, data), data


@pytest.mark.parametrize(
    ("by", "how"),
    [(0.0, ""), (4.0, "rejection"), (1500.0, "resampled"), (1e12, "NOT in these draws")],
)
def test_prior_draws_follow_the_factors_or_say_that_they_do_not(by, how):
    """N(x; 0, 1) exp(−b x²) is a Gaussian of variance 1/(1 + 2b); b = 1500 keeps a share of 0.018,
    300 of the 16,384 draws, which by weight are worth 420."""
    problem, data = narrowed(by)
    drawn = prior_sample(problem, data, jax.random.key(0), 500)
    sd = 1.0 / np.sqrt(1.0 + 2.0 * by)
    assert drawn.honoured == (how != "NOT in these draws")
    assert how in drawn.note
    assert bool(drawn.note) == bool(how)
    if drawn.honoured:
        assert drawn.z.std() == pytest.approx(sd, rel=0.25)
    else:
        assert drawn.z.std() == pytest.approx(1.0, rel=0.15)


def test_the_prior_of_the_file_is_that_of_facets_that_are_seen(written):
    """All its draws are of a facet that the factor lets be seen; without it a third are not. Where
    epochs look at the body from opposite sides there is none that is not seen."""
    result, _, (_, n_dark) = written
    if n_dark:
        assert result["prior"].attrs["factors"] == "none"
        return
    problem, data = PROBLEM, Epochs.of(lcbayes.load_light_curve(result))
    prior = result["prior"]
    assert prior.attrs["with_factors"] == 1
    assert "rejection" in prior.attrs["factors"]
    sites = {k: jnp.asarray(prior[k].to_numpy()[0]) for k in problem.names}
    factors = jax.vmap(lambda s: problem.log_factors(problem.ravel(s), data))(sites)
    assert float(jnp.mean(factors < -3.0)) < 0.02
    plain = jax.vmap(lambda k: problem.log_factors(problem.prior_draw(k, data), data))
    assert float(jnp.mean(plain(jax.random.split(jax.random.key(1), 500)) < -3.0)) > 0.2


def test_inverse_mass_matrix_of_each_chain():
    stats = made(2, 0)["modes/1/sample_stats"]
    matrix = stats["inverse_mass_matrix"]
    assert matrix.dims == ("chain", "coordinate", "other_coordinate")
    assert matrix.shape == (CHAINS, PROBLEM.dim, PROBLEM.dim)
    assert "unconstrained" in matrix.attrs["description"]
    assert matrix.attrs["units"]
    names = matrix["coordinate"].to_numpy()
    assert [n for n in names if n.startswith("normals_base")] == [
        f"normals_base[{i}]" for i in range(3)
    ]
    assert "inverse_mass_matrix" not in stats.attrs
    assert "inverse_mass_matrix" not in made(2, 0)["sample_stats"]


def test_attributes_say_what_ahmc_settled_on():
    light = small_curves.curve(20)
    settings = {"num_warmup": 100, "num_samples": 50, "num_starts": 16, "num_chains": 2}
    result = lcbayes.fit(light, sampler="ahmc", seed=1, **settings, **OPTIONS)
    attrs = result.tree["sample_stats"].attrs
    assert attrs["sampler"] == "ahmc"
    assert set(np.atleast_1d(attrs["proposal_scale"])) <= {0.5, 1.0, np.inf}
    assert np.all(np.asarray(attrs["num_fallback"]) >= 0)
    assert np.all(np.asarray(attrs["step_size"]) > 0)


def test_every_variable_has_its_unit(written):
    _, file, _ = written
    expected = {"albedo_area": "m2", "phi": "rad", "g": "1", "log_albedo_area": "1"}
    for group in ("posterior", "prior", "modes/0/posterior"):
        variables = file[group].to_dataset().data_vars
        assert all("units" in v.attrs for v in variables.values())
        for name, unit_of in expected.items():
            assert variables[name].attrs["units"] == unit_of
    light = {"observed_data": "brightness", "posterior_predictive": "brightness"}
    light |= {"constant_data": "error", "modes/0/curves": "expected"}
    for group, name in light.items():
        assert file[group].to_dataset()[name].attrs["units"] == "m2"
    for node in file.subtree:
        numbers = [v for v in node.to_dataset().data_vars.values() if v.dtype.kind in "biuf"]
        assert all(v.attrs.get("units") for v in numbers), node.path
    known = {"t": "s", "exposure_s": "s", "sun": "1", "free_scale": "1"}
    constants = file["constant_data"].to_dataset()
    assert {name: constants[name].attrs["units"] for name in known} == known


def test_curves_without_noise_are_those_of_the_stored_draws(written):
    result, file, (n_solutions, _) = written
    data = Epochs.of(lcbayes.load_light_curve(file))
    for k in range(n_solutions):
        curves = file[f"modes/{k}/curves"].to_dataset()
        assert 40 <= curves.sizes["curve_draw"] <= 41
        lp = file[f"modes/{k}/sample_stats/lp"].to_numpy()
        first = curves.isel(curve_draw=0)
        assert lp[first["chain_of"].item(), first["draw_of"].item()] == lp.max()
        posterior = file[f"modes/{k}/posterior"].to_dataset()
        for one in (0, 17):
            at = curves.isel(curve_draw=one)
            draw = posterior.isel(chain=at["chain_of"].item(), draw=at["draw_of"].item())
            sites = {name: jnp.asarray(draw[name].to_numpy()) for name in ("log_albedo_area",)}
            sites["normals_base"] = jnp.asarray(draw["normals_base"].to_numpy())
            model = numpyro.handlers.substitute(PROBLEM.model, sites)
            trace = numpyro.handlers.trace(numpyro.handlers.seed(model, 0)).get_trace(data)
            np.testing.assert_allclose(trace["expected"]["value"], at["expected"], rtol=1e-9)
    assert result["modes/0/curves"].to_dataset().identical(file["modes/0/curves"].to_dataset())


@pytest.mark.parametrize(
    ("name", "relative", "magnitude", "expected"),
    [
        ("omega", False, False, "rad/s"),
        ("pole_lon_deg", True, False, "deg"),
        ("period_h", True, False, "h"),
        ("albedo_area", True, False, "1"),
        ("sigma", False, True, "mag"),
        ("sigma", False, False, "1"),
        ("member_offset", False, True, "mag"),
        ("member_sd", False, True, "mag"),
        ("clock_offset_s", False, True, "s"),
    ],
)
def test_units(name, relative, magnitude, expected):
    assert unit(name, relative=relative, magnitude=magnitude) == expected
