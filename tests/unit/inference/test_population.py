"""Particles told apart: on clouds whose solutions, weights and order of facets are known."""

from __future__ import annotations

import numpy as np
import pytest

from lcbayes.core.checkpoint import Checkpoint
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.progress import Silent
from lcbayes.inference import basins, population
from lcbayes.inference.label_switching import FacetOrder
from lcbayes.inference.replicates import Execution
from lcbayes.inference.solutions import Solution
from lcbayes.results.reasons import reason as sentence
from lcbayes.samplers import smc
from lcbayes.samplers.chains import Whitening
from lcbayes.samplers.sampling import Timing
from lcbayes.samplers.settings import Settings
from tests.helpers import small_curves

SITES = ("normals_base", "log_albedo_area")
N_RUNS, N = 3, 1200


@pytest.fixture(scope="module")
def case():
    problem, data = small_curves.posterior(small_curves.curve(30), n_facets=2, spin="none")
    return problem, data, FacetOrder(problem, SITES)


def solution(z: np.ndarray) -> Solution:
    return Solution(z, 0.0, 0.0, 0.01, 1)


def cloud(case, at: tuple[np.ndarray, np.ndarray], n: int, rng) -> np.ndarray:
    """n points about z with a spread of 0.3 F^(−½), the facets of each in an order of its own."""
    problem, _, order = case
    z, factor = at
    points = z + 0.3 * rng.standard_normal((n, problem.dim)) @ factor.T
    return np.array([order.by_size(row, rng.random(2)) for row in points]).reshape(n, problem.dim)


@pytest.fixture(scope="module")
def two(case) -> list[tuple[np.ndarray, np.ndarray]]:
    """Two bodies, far from each other, and F^(−½) of each."""
    problem, data, _ = case
    one = np.asarray(small_curves.truth(problem, data, 2))
    other = problem.unravel(jnp.asarray(one))
    turned = jnp.asarray(other["normals_base"]) @ jnp.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    both = one, np.asarray(problem.ravel({**other, "normals_base": turned}))
    return [(z, Whitening.at(problem, z, data).factor) for z in both]


def centres(two) -> list[np.ndarray]:
    return [z for z, _ in two]


def sampled(case, monkeypatch, clouds, at, log_z=(0.0, 0.0, 0.0), n=150, **asked):
    """`population.sample` of runs that hold these clouds."""
    problem, data, order = case
    runs = [
        smc.Result(z, np.zeros(len(z)), one, [], len(z) // n, 0, 0.0)
        for z, one in zip(clouds, log_z, strict=True)
    ]
    monkeypatch.setattr(population, "_runs", lambda *_: runs)
    monkeypatch.setattr(basins, "optima", lambda *_: [solution(z) for z in at])
    monkeypatch.setattr(basins.Basins, "evidence", lambda *_: {})  # these clouds are no posterior
    settings = Settings("smc", num_samples=n, num_chains=len(runs), **asked)
    modes, log_evidence, reasons = population.sample(
        problem,
        data,
        [],
        order,
        Execution(settings, 1, Checkpoint(None, {})),
        jax.random.key(0),
        Timing(),
        Silent(),
    )
    return modes, log_evidence, [sentence(result).text for result in reasons]


def mixed(case, two, shares, seed: int) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    runs = []
    for share in shares:
        count = round(share * N)
        parts = [cloud(case, two[0], count, rng), cloud(case, two[1], N - count, rng)]
        runs.append(rng.permutation(np.concatenate(parts)))
    return runs


def test_weights_and_their_spread(case, two, monkeypatch):
    """Shares 0.68, 0.70, 0.72 → 0.70, with the error of a mean of three; facets in one order."""
    clouds = mixed(case, two, (0.68, 0.70, 0.72), 1)
    modes, _, reasons = sampled(case, monkeypatch, clouds, centres(two))
    assert reasons == []
    assert [m.weight for m in modes] == pytest.approx([0.7, 0.3], abs=1e-3)
    assert modes[0].weight_sd == pytest.approx(0.02 / np.sqrt(3), rel=1e-6)
    assert modes[0].run_weights == pytest.approx(np.array([0.68, 0.70, 0.72]), abs=1e-9)
    assert modes[0].log_evidence.value == pytest.approx(np.log(0.7), abs=1e-3)
    for mode, centre in zip(modes, centres(two), strict=True):
        assert mode.z.shape == (N_RUNS, 450, case[0].dim)
        np.testing.assert_allclose(mode.z.mean((0, 1)), centre, atol=0.05)


def test_runs_count_by_their_evidence(case, two, monkeypatch):
    """Each run's evidence is unbiased, so the mean over runs is of evidence times share."""
    log_z = (0.0, 1.0, 2.0)
    clouds = mixed(case, two, (0.66, 0.70, 0.74), 2)
    modes, *_ = sampled(case, monkeypatch, clouds, centres(two), log_z)
    z = np.exp(log_z)
    assert modes[0].weight == pytest.approx(z @ [0.66, 0.70, 0.74] / z.sum(), abs=1e-3)
    total = np.log(z.mean())
    assert modes[0].log_evidence.value == pytest.approx(total + np.log(modes[0].weight), abs=1e-9)


def test_disagreement_is_reported(case, two, monkeypatch):
    modes, _, reasons = sampled(
        case, monkeypatch, mixed(case, two, (1.0, 0.5, 0.9), 3), centres(two)
    )
    assert len(modes) == 2
    assert any("weights from 0.50 to 1.00" in r and "--num-samples" in r for r in reasons)


def test_centres_along_one_cloud_are_one_solution(case, two, monkeypatch):
    """Optima on a ridge: the particles between them belong to neither more than to the other."""
    rng = np.random.default_rng(4)
    z, factor = two[0]
    beside = z + 0.3 * factor[:, 0]
    clouds = [cloud(case, two[0], N, rng) for _ in range(N_RUNS)]
    modes, _, reasons = sampled(case, monkeypatch, clouds, [z, beside])
    assert reasons == []
    assert [m.weight for m in modes] == [1.0]
    apart, *_ = sampled(case, monkeypatch, mixed(case, two, (0.5,) * 3, 5), centres(two))
    assert len(apart) == 2


def test_a_centre_without_particles_is_no_solution(case, two, monkeypatch):
    rng = np.random.default_rng(6)
    clouds = [cloud(case, two[1], N, rng) for _ in range(N_RUNS)]
    modes, *_ = sampled(case, monkeypatch, clouds, centres(two))
    assert len(modes) == 1
    np.testing.assert_array_equal(modes[0].solution.z, two[1][0])


def test_weights_are_those_of_the_whole_posterior_where_solutions_are_left_out(
    case, two, monkeypatch
):
    clouds = mixed(case, two, (0.68, 0.70, 0.72), 7)
    whole = sampled(case, monkeypatch, clouds, centres(two))
    (mode,), log_evidence, reasons = sampled(case, monkeypatch, clouds, centres(two), max_modes=1)
    assert mode.weight == whole[0][0].weight == pytest.approx(0.7, abs=1e-3)
    assert log_evidence == whole[1]
    np.testing.assert_allclose(log_evidence, 0.0, atol=1e-9)  # of the ways, no weight's error in it
    assert whole[2] == []
    assert reasons == [
        "1 more solution was not sampled, which may hold 30 % of the posterior: raise --max-modes"
    ]


@pytest.mark.parametrize(
    ("shares", "chains", "says"),
    [
        ((0.85, 1.0, 1.0), 1, ["only 1 of 3 runs found solution 2"]),
        ((0.85, 0.999, 0.999), 1, ["only 1 of 3 runs found solution 2"]),  # one particle each
        ((0.86, 0.86, 1.0), 2, []),
        ((0.86, 0.87, 0.85), 3, []),
        ((0.98, 1.0, 1.0), 1, []),  # too light to matter
    ],
)
def test_chains_are_of_the_runs_that_found_a_solution(case, two, monkeypatch, shares, chains, says):
    """No chain is a copy of another run's particles, which R-hat would find in agreement."""
    clouds = mixed(case, two, shares, 8)
    modes, _, reasons = sampled(case, monkeypatch, clouds, centres(two))
    assert [len(m.z) for m in modes] == [3, chains]
    assert [r.split(":")[0] for r in reasons] == says
    assert sum(m.weight for m in modes) == pytest.approx(1.0)
