"""Weights of solutions: bridge sampling against what is known exactly."""

from __future__ import annotations

import numpy as np
import pytest

from lcbayes.core.checkpoint import Checkpoint
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.progress import Silent
from lcbayes.inference import fit
from lcbayes.inference.modes import left_out, unsampled
from lcbayes.inference.search import SearchState
from lcbayes.inference.solutions import Solution
from lcbayes.modelling import registry
from lcbayes.modelling.constrained import constrain_draws, potentials
from lcbayes.results.reasons import reason as sentence
from lcbayes.samplers import bridge
from lcbayes.samplers.settings import Settings
from tests.helpers import small_curves
from tests.helpers.false_alarms import EACH, limit, squares


@pytest.mark.statistical(false_alarm=EACH)
@pytest.mark.parametrize("dim", [1, 3, 10])
def test_gaussian(dim):
    """ln ∫ exp(−½ xᵀPx − c) = ½ D ln 2π − ½ ln|P| − c."""
    rng = np.random.default_rng(dim)
    a = rng.standard_normal((dim, dim)) + 3 * np.eye(dim)
    draws = rng.multivariate_normal(np.zeros(dim), np.linalg.inv(a @ a.T), (4, 500))
    found = bridge.bridge(
        draws, lambda x: 0.5 * np.sum((x @ a) ** 2, axis=1) + 7.0, draws[..., 0].size, rng
    )
    want = 0.5 * dim * np.log(2 * np.pi) - np.linalg.slogdet(a)[1] - 7.0
    assert abs(found.value - want) < limit() * found.se + 1e-6
    assert found.se < 0.1


def test_known_potentials_of_the_draws_give_the_same_evidence():
    draws = np.random.default_rng(0).standard_normal((2, 50, 3))
    computed = []

    def potential(x):
        computed.append(len(x))
        return 0.5 * np.sum(x**2, axis=1)

    found = [
        bridge.bridge(draws, potential, 100.0, np.random.default_rng(1), known)
        for known in (None, 0.5 * np.sum(draws**2, axis=2))
    ]
    assert found[0] == pytest.approx(found[1], rel=1e-12)
    assert computed == [50, 50, 50]  # the second time only the proposals, as many as half the draws


@pytest.mark.statistical(false_alarm=EACH)
def test_skewed():
    """A log-gamma density, ∫ exp(kx − eˣ) dx = Γ(k); the pulls of 120 seeds are standard normal by
    their sum of squares: an error that is wrong by 1.5 is found out."""
    from scipy.special import gammaln

    k, pulls = 3.0, []
    for seed in range(120):
        rng = np.random.default_rng(seed)
        draws = np.log(rng.gamma(k, size=(2, 400, 1)))
        found = bridge.bridge(draws, lambda x: np.exp(x[:, 0]) - k * x[:, 0], 800.0, rng)
        pulls.append((found.value - gammaln(k)) / found.se)
    low, high = squares(120)
    assert low < np.sum(np.square(pulls)) < high


@pytest.mark.statistical(false_alarm=EACH)
def test_a_proposal_without_density_counts_as_none():
    """Half of a Gaussian: points beyond the edge have an infinite potential."""
    rng = np.random.default_rng(0)
    draws = np.abs(rng.standard_normal((2, 2000, 1)))
    found = bridge.bridge(
        draws, lambda x: np.where(x[:, 0] > 0, 0.5 * x[:, 0] ** 2, np.nan), 4000.0, rng
    )
    assert abs(found.value - np.log(np.sqrt(np.pi / 2))) < limit() * found.se


@pytest.mark.parametrize("away", [40.0, 1e4])
def test_halves_that_do_not_overlap_leave_the_weight_open(away):
    """A chain that wanders off: the solution keeps a weight, which is known not to be known."""
    rng = np.random.default_rng(0)
    draws = rng.standard_normal((4, 400, 2))
    draws[:, 200:] += away

    def potential(x):  # two Gaussians of weight one half
        near, far = (np.sum((x - at) ** 2, axis=1) for at in (0.0, away))
        return 0.5 * np.minimum(near, far) + np.log(2.0) + np.log(2 * np.pi)

    found = bridge.bridge(draws, potential, 200.0, rng)
    assert np.isfinite(found).all()
    assert found.value > -np.log(2.0) - 0.1  # a lower bound: one of the two at least
    assert found.se > 0.5
    nowhere = bridge.bridge(
        draws, lambda x: np.where(x[:, 0] > 0.5 * away, 1.0, np.inf), 200.0, rng
    )
    assert np.isfinite(nowhere).all()
    assert nowhere.se > 0.5


@pytest.fixture(scope="module")
def one_facet():
    light = small_curves.curve(20, noise=0.1)
    options = {"n_facets": 1, "spin": "none"}
    settings = Settings(num_warmup=200, num_samples=400, num_starts=16)
    found = fit.run(
        light, registry.find("faceted"), options, settings, Checkpoint(None, {}), Silent()
    )
    return found


def test_the_potential_of_a_draw_is_that_recorded_with_it(one_facet):
    """The bridge takes it from the chains instead of computing it again."""
    (mode,) = one_facet.modes
    right = potentials(one_facet.problem, mode.z.reshape(-1, mode.z.shape[2]), one_facet.data)
    assert mode.stats["potential_energy"].ravel() == pytest.approx(right, abs=1e-8)


@pytest.mark.statistical(false_alarm=EACH)
def test_one_facet_posterior_against_quadrature(one_facet):
    """Evidence and means of α, u by a grid over the sphere and ln α."""
    found = one_facet
    problem, data = found.problem, found.data
    assert len(found.modes) == 1
    # Integrate over directions and ln α: the radius carries nothing, its density integrates to 1.
    centre = found.modes[0].z.reshape(-1, problem.dim)
    sites = constrain_draws(problem, found.modes[0].z, data)
    g0, phi0 = sites["g"].ravel(), sites["phi"].ravel()
    log0 = sites["log_albedo_area"].ravel()
    axes = [
        np.linspace(x.mean() - 7 * x.std(), x.mean() + 7 * x.std(), 41) for x in (g0, phi0, log0)
    ]
    g, phi, log_area = (x.ravel() for x in np.meshgrid(*axes, indexing="ij"))
    s = np.sqrt(1 - g**2)
    u = np.stack([s * np.cos(phi), s * np.sin(phi), g], axis=1)

    @jax.jit
    def log_density(u, a):
        def one(args):
            z = problem.ravel({"normals_base": args[0][None], "log_albedo_area": args[1][None]})
            return -problem.potential(z, data)

        return jax.lax.map(one, (u, a), batch_size=256)

    # At |b| = 1 the direction's density is 1/(4π √(2π) ρ); per unit of solid angle it is 1/(4π).
    log_p = np.array(log_density(jnp.asarray(u), jnp.asarray(log_area)))
    log_p += 0.5 * np.log(2 * np.pi) + np.log(0.1)
    p = np.exp(log_p - log_p.max())
    cell = np.prod([x[1] - x[0] for x in axes])
    want = np.log(p.sum() * cell) + log_p.max()
    log_z = found.modes[0].log_evidence
    assert centre.shape[1] == 4
    assert log_z.se < 0.1
    most = limit(7)
    assert abs(log_z.value - want) < most * log_z.se
    p /= p.sum()
    for draws, grid in ((g0, g), (phi0, phi), (log0, log_area)):
        mean = p @ grid
        sd = np.sqrt(p @ (grid - mean) ** 2)
        # at least 400 effective draws
        assert abs(draws.mean() - mean) < most * sd / 20
        assert abs(draws.std() / sd - 1) < most / np.sqrt(800)


def test_hits_are_counted_along_a_ridge(one_facet):
    """Ends within the draws of a mode are its own, however far apart by the local metric."""
    found = one_facet
    problem, data = found.problem, found.data
    rng = np.random.default_rng(0)
    # A ridge ten times longer than the metric at its optimum tells.
    stretched = found.modes[0].z.copy()
    stretched[..., -1] += 10 * stretched[..., -1].std() * rng.standard_normal(stretched.shape[:2])
    flat = stretched.reshape(-1, problem.dim)
    inside = flat[:: len(flat) // 40]
    away = flat.mean(0) + 30 * flat.std(0)
    ends = SearchState(
        jnp.asarray(np.vstack([inside, away])),
        jnp.zeros(len(inside) + 1),
        jnp.ones(len(inside) + 1),
        jnp.zeros(len(inside) + 1, int),
    )
    mode = fit.Mode(
        Solution(flat.mean(0), 0.0, 0.0, 1.0, 1), stretched, {}, bridge.LogEvidence(0.0, 0.1)
    )
    order = fit.FacetOrder(problem, registry.find("faceted").facet_sites)
    fit.recount([mode], problem, problem, ends, order, data)
    assert 0.9 * len(inside) <= mode.solution.hits <= len(inside)


def test_weights_of_modes_and_their_errors():
    modes = [
        fit.Mode(
            Solution(np.zeros(4), 0.0, 0.0, 1.0, 1),
            np.zeros((2, 100, 4)),
            {},
            bridge.LogEvidence(np.log(w), 0.1),
        )
        for w in (3.0, 1.0)
    ]
    np.testing.assert_allclose(fit.weigh(modes), [np.log(4.0), 0.1 * np.hypot(0.75, 0.25)])
    np.testing.assert_allclose([m.weight for m in modes], [0.75, 0.25])
    # d w₁ = w₁ w₂ (dz₁ − dz₂)
    np.testing.assert_allclose(modes[0].weight_sd, 0.75 * 0.25 * 0.1 * np.sqrt(2))


def test_solutions_that_were_not_sampled_are_told_of_unless_they_lie_within_a_mode():
    problem, data = small_curves.posterior(small_curves.curve(8), n_facets=1, spin="none")
    order = fit.FacetOrder(problem, registry.find("faceted").facet_sites)
    z = np.random.default_rng(3).standard_normal((2, 500, 4))
    mode = fit.Mode(Solution(np.zeros(4), 0.0, 0.0, 1.0, 1), z, {}, bridge.LogEvidence(5.0, 0.1))

    def told(*rest: tuple[float, float]) -> list[str]:
        left = [Solution(np.full(4, x), 0.0, log_z, 1.0, 1) for x, log_z in rest]
        found, share = unsampled([mode], problem, problem, left, order, data)
        return [sentence(one).text for one in left_out(len(found), share)]

    assert told() == told((0.5, 0.0)) == told((30.0, -4.7)) == []  # 0.9 %
    (one,) = told((30.0, 0.0), (0.5, 0.0))
    assert one.startswith("1 more solution was not sampled, which may hold 50 % of the posterior")
    (two,) = told((30.0, 0.0), (-30.0, 0.0))
    assert two.startswith("2 more solutions were not sampled, which may hold 67 %")
    assert two.endswith("raise --max-modes")


def test_two_runs_into_one_region_are_one_mode_whatever_their_lengths():
    problem, _ = small_curves.posterior(small_curves.curve(8), n_facets=1, spin="none")
    order = fit.FacetOrder(problem, registry.find("faceted").facet_sites)
    rng = np.random.default_rng(2)
    solution = Solution(np.zeros(4), 0.0, 0.0, 1.0, 1)
    long, short, away = (
        fit.Mode(solution, z, {}, bridge.LogEvidence(log_z, 0.1))
        for z, log_z in (
            (rng.standard_normal((2, 1000, 4)), 0.0),
            (rng.standard_normal((2, 400, 4)), 1.0),
            (rng.standard_normal((2, 400, 4)) + 30.0, 2.0),
        )
    )
    modes = []
    for new in (long, short, away):
        fit.join(modes, new, order)
    assert [len(m.z[0]) for m in modes] == [400, 400]
    assert 1.0 <= modes[0].apart < 1.05
    assert modes[1].apart == 1.0
