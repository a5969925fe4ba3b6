"""Solutions of one rotation are one, and several rotations have their true weights."""

from dataclasses import dataclass, replace
from itertools import permutations
from typing import Any

import numpy as np
import pytest
from jax.scipy.spatial.transform import Rotation

from lcbayes.core.checkpoint import Checkpoint
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.progress import Silent
from lcbayes.inference import warped_bridge
from lcbayes.inference.arrangements import by_motion, joint, number_to_sample, plausible
from lcbayes.inference.fit import Stages
from lcbayes.inference.label_switching import FacetOrder
from lcbayes.inference.modes import Mode
from lcbayes.inference.solutions import Solution
from lcbayes.inference.warped_bridge import (
    APART_SE,
    gaussian_error,
    with_annealed,
    with_ratios,
)
from lcbayes.modelling import registry
from lcbayes.samplers.bridge import LogEvidence
from lcbayes.samplers.settings import Settings
from tests.helpers import small_curves

N = 3
SPAN = 10_000.0
RATIO = 0.2  # of the second evidence to the first


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Times:
    t: Any
    sun: Any
    obs: Any


@dataclass(frozen=True)
class TwoRotations:
    """A density of two Gaussians; z = ω (3), normals (9), ln areas (3)."""

    dim: int = 3 + 4 * N
    shading: None = None

    def unravel(self, z):
        return {
            "normals_base": z[3 : 3 + 3 * N].reshape(N, 3),
            "log_albedo_area": z[3 + 3 * N :],
            "omega": z[:3],
        }

    def rows(self, names):
        rows = {
            "normals_base": np.arange(3, 3 + 3 * N),
            "log_albedo_area": 3 + 3 * N + np.arange(N),
        }
        return np.concatenate([rows[name] for name in names])

    def constrain(self, z, data):
        turn = Rotation.from_rotvec(-data.t[:, None] * z[:3]).as_matrix()
        sun, obs = (jnp.einsum("tij,tj->ti", turn, v) for v in (data.sun, data.obs))
        return self.unravel(z) | {"sun_body": sun, "obs_body": obs}

    def potential(self, z, data):  # noqa: ARG002
        """Facets are exchangeable, as in the posterior of a body."""
        normals, areas = z[3 : 3 + 3 * N].reshape(N, 3), z[3 + 3 * N :]
        each = []
        for order in permutations(range(N)):
            i = np.array(order)
            row = jnp.concatenate([z[:3], normals[i].ravel(), areas[i]])
            for weight, mean, sd in zip((1.0, RATIO), *parts(), strict=True):
                log_density = -jnp.sum(0.5 * ((row - mean) / sd) ** 2 + jnp.log(sd))
                each.append(jnp.log(weight) + log_density)
        return -jax.nn.logsumexp(jnp.stack(each))


def parts():
    """Means and sd (D,) of the two rotations: the second turns once more in the time span.

    The third facet is weak: it is free on the sphere, and wide in ln area.
    """
    omega = np.array([0.0, 0.0, 0.05])
    normals = np.array([[1.0, 0.0, 0.0], [0.0, 0.8, 0.6], [0.0, 0.0, 0.0]])
    areas = np.array([0.5, 0.0, -3.0])
    first = np.concatenate([omega, normals.ravel(), areas])
    later = omega + np.array([1e-4, 0.0, 2 * np.pi / SPAN])
    shifted = normals + np.array([[0.0, 0.05, 0.0], [0.03, 0.0, 0.0], [0.0, 0.0, 0.0]])
    second = np.concatenate([later, shifted.ravel(), areas + np.array([0.1, -0.1, 0.0])])
    sd = np.concatenate([[1e-4, 1e-4, 1e-7], [0.02] * 6, [1.0] * 3, [0.05, 0.05, 1.0]])
    wider = np.where(sd < 1.0, 1.5 * sd, sd)
    return (first, second), (sd, wider)


@pytest.fixture
def data():
    """Two passes, the first of them at t = 0."""
    t = np.concatenate([np.linspace(0.0, 200.0, 60), SPAN + np.linspace(0.0, 100.0, 20)])
    return Times(t, np.ones((80, 3)), np.ones((80, 3)))


def mode(index, rng, n=3000):
    mean, sd = (x[index] for x in parts())
    z = mean + sd * rng.standard_normal((4, n // 4, mean.size))
    solution = Solution(mean, 0.0, -float(index), 0.0, 1)
    return Mode(solution, z, {}, LogEvidence(0.0, 50.0))


def test_the_ratio_of_two_rotations(data):
    problem: Any = TwoRotations()
    order = FacetOrder(problem, ("normals_base", "log_albedo_area"))
    rng = np.random.default_rng(0)
    first, second = with_ratios([mode(0, rng), mode(1, rng)], problem, order, data)
    assert first.log_evidence.se == 0.0
    ratio = second.log_evidence.value - first.log_evidence.value
    assert second.log_evidence.se < 0.3
    assert abs(ratio - np.log(RATIO)) < 4.0 * second.log_evidence.se


def test_solutions_that_do_not_overlap_keep_a_large_error(data):
    problem: Any = TwoRotations()
    order = FacetOrder(problem, ("normals_base", "log_albedo_area"))
    rng = np.random.default_rng(1)
    wrong = mode(1, rng)
    wrong.z = wrong.z + 100.0 * rng.standard_normal(wrong.z.shape)  # not draws of the density
    _, second = with_ratios([mode(0, rng), wrong], problem, order, data)
    assert second.log_evidence.se == APART_SE


def test_a_solution_is_related_through_another_that_it_overlaps_with(monkeypatch, data):
    """Ratios by bridges of 1 to 2 and of 2 to 3 give that of 1 to 3, whose own bridge fails."""
    problem: Any = TwoRotations()
    order = FacetOrder(problem, ("normals_base", "log_albedo_area"))
    rng = np.random.default_rng(0)
    modes = [mode(k % 2, rng, 40) for k in range(3)]
    for k, one in enumerate(modes):
        one.solution = replace(one.solution, log_evidence=-float(k))
    steps = {(0, 1): (-0.5, 0.24), (0, 2): (9.0, 5.0), (1, 2): (-0.7, 0.32)}
    names = {id(one): k for k, one in enumerate(modes)}
    monkeypatch.setattr(warped_bridge, "_form", lambda one, *_: names[id(one)])
    monkeypatch.setattr(warped_bridge, "_ratio", lambda a, b, *_: LogEvidence(*steps[a, b]))
    first, second, third = (m.log_evidence for m in with_ratios(modes, problem, order, data))
    assert (second.value - first.value, second.se) == pytest.approx((-0.5, 0.24))
    assert (third.value - first.value, third.se) == pytest.approx((-1.2, 0.4))


def test_solutions_that_do_not_overlap_are_weighed_by_annealing(data):
    """The ratio is that of a given function of the draws of both and of the map between them."""
    problem: Any = TwoRotations()
    order = FacetOrder(problem, ("normals_base", "log_albedo_area"))
    rng = np.random.default_rng(1)
    wrong = mode(1, rng)
    wrong.z = wrong.z + 100.0 * rng.standard_normal(wrong.z.shape)

    def annealed(first, second, matrix, shift):
        assert np.abs(first).max() < 50.0 < np.abs(second).max()
        determined = slice(0, 3)  # the angular velocity, which is not free in either
        mapped = first.mean(axis=0) @ matrix.T + shift
        np.testing.assert_allclose(mapped[determined], second.mean(axis=0)[determined], atol=1e-9)
        return LogEvidence(-2.0, 0.5)

    apart = with_ratios([mode(0, rng), wrong], problem, order, data)
    first, second = with_annealed(apart, problem, order, data, annealed)
    assert second.log_evidence.value - first.log_evidence.value == pytest.approx(-2.0)
    assert second.log_evidence.se == pytest.approx(0.5)

    def failed(*between):  # noqa: ARG001
        return LogEvidence(-np.inf, np.inf)

    _, second = with_annealed(apart, problem, order, data, failed)
    assert second.log_evidence.se == APART_SE
    assert np.isfinite(second.log_evidence.value)


@pytest.mark.parametrize(
    ("deficits", "number"),
    [
        ((0.0,), 4),
        ((0.0, 1.0, 3.0, 5.0, 6.0), 5),  # the fifth may hold 5 % if its evidence is 3 nats higher
        ((0.0, 1.0, 3.0, 5.0, 20.0), 4),
        ((0.0,) * 8, 8),
        ((0.0,) * 9, 4),
    ],
)
def test_all_rotations_are_sampled_if_they_are_few(deficits, number):
    groups = [[Solution(np.zeros(2), 0.0, -deficit, 0.0, 1)] for deficit in deficits]
    assert number_to_sample(groups, 4) == number


@pytest.mark.parametrize(
    ("deficits", "number"),
    [((0.0, 15.0, 16.0), 1), ((0.0, 6.0, 15.0), 2), ((0.0,) * 6, 4)],
)
def test_no_hopeless_solution_of_a_nearly_gaussian_posterior_is_sampled(deficits, number):
    groups = [[Solution(np.zeros(2), 0.0, -deficit, 0.0, 1)] for deficit in deficits]
    assert number_to_sample(groups, 4, near_gaussian=True) == number


def test_bridges_show_the_error_of_gaussian_approximations():
    def related(*solutions):
        """Modes of given Gaussian evidences, and errors and differences of their bridges."""
        return [
            Mode(
                Solution(np.zeros(2), 0.0, gaussian, 0.0, 1),
                np.zeros((1, 2, 2)),
                {},
                LogEvidence(gaussian + 7.0 + difference, se),
            )
            for gaussian, difference, se in solutions
        ]

    base = (3.0, 0.0, 0.0)
    assert gaussian_error(related(base, (2.0, 0.4, 0.1), (1.0, -0.6, 0.2))) == pytest.approx(0.8)
    assert gaussian_error(related(base, (2.0, 0.4, 0.1), (1.0, 0.0, APART_SE))) == APART_SE
    assert gaussian_error(related(base, (2.0, 9.0, 0.1), (1.0, 0.2, 0.1))) == APART_SE


def test_solutions_are_grouped_by_motion(data):
    problem: Any = TwoRotations()
    rows = np.stack([parts()[0][0]] * 4)
    rows[1, 3:] = 0.3  # other facets
    rows[2, 2] += 2 * np.pi / SPAN  # a turn more
    rows[3, :3] = [0.05, 0.0, 0.0]  # another axis
    log_evidence = [0.0, -0.5, 0.2, -3.0]
    given = [Solution(z, 0.0, e, 0.0, 2) for z, e in zip(rows, log_evidence, strict=True)]
    groups = by_motion(problem, data, given)
    sizes = [len(g) for g in groups]
    assert sizes == [2, 1, 1]
    whole = joint(groups[0])
    assert whole.hits == 4
    assert whole.log_evidence == pytest.approx(np.log(1.0 + np.exp(-0.5)))
    np.testing.assert_array_equal(whole.z, rows[0])


def test_chains_begin_at_optima_that_may_hold_a_noticeable_share():
    """With an error of 1 nat, a share of exp(-7) may be exp(-5), which is below 1 %."""
    group = [Solution(np.zeros(1), 0.0, e, 0.0, 1) for e in (0.0, -6.0, -7.0)]
    assert plausible(group, 1.0) == group[:2]
    assert plausible(group, 0.0) == group[:1]


def test_arrangements_of_one_rotation_do_not_crowd_out_another():
    """Forty bodies at one rotation are more probable than any at the other, which is kept."""
    entry = registry.find("faceted")
    options = {"n_facets": 3, "omega_sd": 0.1}
    problem, data = small_curves.posterior(small_curves.curve(20, spinning=True), **options)
    rng = np.random.default_rng(2)
    rows = rng.standard_normal((41, problem.dim))
    rows[:, problem.rows(["omega_unit"])] = [0.5, 0.0, 0.5]
    rows[40, problem.rows(["omega_unit"])] = [0.0, 0.9, 0.0]
    found = [Solution(z, 0.0, -0.01 * i, 1.0, 1) for i, z in enumerate(rows)]
    found[40] = replace(found[40], log_evidence=-8.0)
    settings = Settings(max_modes=2)
    stages = Stages.of(problem, entry, options, settings, Checkpoint(None, {}), Silent())
    kept = stages.most_probable(problem, data, found)
    assert len(kept) < 20
    assert kept[0] is found[0]
    assert kept[-1] is found[40]
    nuts = Stages.of(
        problem, entry, options, settings.with_sampler("nuts"), Checkpoint(None, {}), Silent()
    )
    assert nuts.most_probable(problem, data, found) == found[:8]
