"""What warm-up finds, against numbers worked out beside it."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from scipy.linalg import eigvalsh
from scipy.signal import lfilter

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.samplers.kernels import HMC, adaptation, trajectory
from lcbayes.samplers.kernels.adaptation import (
    COMPARE,
    EDGES,
    NARROW,
    SETTLE,
    Haario,
    Tuner,
    Tuning,
)
from tests.helpers.false_alarms import EACH, limit

# ------------------------------------------------------------------------ step size


def test_dual_averaging_is_the_published_recursion():
    """Hoffman & Gelman (2014), algorithm 5, lines on H̄ and ε, for one of three candidates."""
    accepts = np.random.default_rng(0).uniform(0.0, 1.0, 40)
    gamma, t0, kappa, target, mu = 0.05, 10.0, 0.75, 0.8, np.log(0.3)
    h, average = 0.0, 0.0
    steps = adaptation.steps_at(jnp.asarray(mu), 3)
    update = jax.jit(partial(adaptation.steps_update, target=target))
    for m, a in enumerate(accepts, start=1):
        h = (1 - 1 / (m + t0)) * h + (target - a) / (m + t0)
        log_step = mu - np.sqrt(m) / gamma * h
        average = m**-kappa * log_step + (1 - m**-kappa) * average
        steps = update(steps, 1, a)
        np.testing.assert_allclose(steps.log_step[1], log_step, rtol=1e-12)
        np.testing.assert_allclose(steps.average[1], average, rtol=1e-12)
    for k in (0, 2):
        assert float(steps.log_step[k]) == float(steps.average[k]) == pytest.approx(mu)
        assert float(steps.count[k]) == 0


@pytest.mark.statistical(false_alarm=EACH)
@pytest.mark.parametrize("target", [0.234, 0.8, 0.95])
@pytest.mark.parametrize("first", [1e-3, 0.3, 50.0])
def test_dual_averaging_reaches_its_target(target, first):
    """Acceptance exp(−(ε/0.3)²) plus noise of sd 0.1: 1000 steps leave 0.01 of bias at most, and
    0.006 of scatter, of which the mean of 300 runs has a 17th.
    """

    def curve(step_size):
        return jnp.exp(-((step_size / 0.3) ** 2))

    def once(steps, key):
        accept = curve(jnp.exp(steps.log_step[0])) + 0.1 * jax.random.normal(key)
        return adaptation.steps_update(steps, jnp.array(0), accept, target), None

    @jax.jit
    @jax.vmap
    def reached(key):
        begin = adaptation.steps_at(jnp.log(first), 1)
        steps, _ = jax.lax.scan(once, begin, jax.random.split(key, 1000))
        return curve(jnp.exp(steps.average[0]))

    result = np.asarray(reached(jax.random.split(jax.random.key(1), 300)))
    assert limit() * result.std() / np.sqrt(300) < 0.002
    assert result.mean() == pytest.approx(target, abs=0.01)


# ----------------------------------------------------------------------- covariance


def accumulated(z: np.ndarray) -> adaptation.Running:
    def add(r, z):
        return adaptation.running_add(r, z), None

    run = jax.jit(partial(jax.lax.scan, add))
    return run(adaptation.running(z.shape[1]), jnp.asarray(z))[0]


@pytest.mark.parametrize("offset", [0.0, 1e7])
def test_running_covariance_is_numpys(offset):
    """Also far from the origin, where a sum of squares would leave nothing."""
    rng = np.random.default_rng(2)
    z = offset + rng.standard_normal((300, 4)) @ rng.standard_normal((4, 4))
    result = accumulated(z)
    np.testing.assert_allclose(result.mean, z.mean(axis=0), rtol=1e-12)
    covariance = np.cov((z - offset).T)
    np.testing.assert_allclose(
        result.scatter / (result.n - 1), covariance, rtol=1e-7 if offset else 1e-11
    )


def test_information_that_is_not_finite_is_left_out():
    r = adaptation.running(2)
    for matrix in (np.eye(2), np.full((2, 2), np.nan), 3 * np.eye(2), np.diag([np.inf, 1.0])):
        r = adaptation.running_inform(r, jnp.asarray(matrix))
    assert float(r.n_information) == 2
    np.testing.assert_array_equal(r.information, 4 * np.eye(2))


def shrunk(z: np.ndarray, information: np.ndarray | None, weight: float) -> np.ndarray:
    """Scatter of the draws and of ``weight`` imagined ones from the guess."""
    dim = z.shape[1]
    guess = 1e-3 * np.eye(dim) if information is None else np.linalg.inv(information)
    scatter = np.cov(z.T) * (len(z) - 1)
    return (scatter + weight * guess) / (len(z) - 1 + weight)


def autocorrelation_length(z: np.ndarray, information: np.ndarray) -> float:
    """(1 + ρ)/(1 − ρ) of the direction with the smallest jumps for its variance, at most n."""
    jumps = np.diff(z, axis=0)
    covariance = shrunk(z, information, z.shape[1] + 5.0)
    half = 0.5 * eigvalsh(jumps.T @ jumps / len(jumps), covariance)[0]
    return float(min((2.0 - min(half, 1.0)) / min(half, 1.0), len(z)))


@pytest.mark.parametrize("rho", [0.0, 0.9, 0.99])
def test_correlation_length_is_that_of_the_slowest_direction(rho):
    """Two coordinates of a known first-order process, mixed by a matrix; ρ of the other is 0.2.

    At 10⁵ draws the length of ρ = 0.99, 199, has a relative error of 5 %, which is 14 times that
    of ρ: the error of ρ̂ is √((1 − ρ²)/n).
    """
    rng = np.random.default_rng(6)
    n, each = 100_000, np.array([rho, 0.2])
    z = lfilter_rows(each, rng.standard_normal((n, 2))) @ np.array([[2.0, 0.0], [0.6, 0.1]])
    r = accumulated(z)
    result = float(adaptation.correlation_length(r, jnp.asarray(np.cov(z.T))))
    slowest = max(each)
    assert result == pytest.approx((1 + slowest) / (1 - slowest), rel=0.2)


def lfilter_rows(rho: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Stationary first-order processes of unit variance, one per column."""
    return np.stack(
        [
            lfilter([np.sqrt(1 - a**2)], [1.0, -a], e, zi=[a * s])[0]
            for a, e, s in zip(rho, noise.T, (0.3, -0.5), strict=True)
        ],
        axis=1,
    )


def test_draws_that_have_hardly_moved_leave_the_guess():
    """A chain that crept along a thousandth of the posterior's width says nothing of the width."""
    rng = np.random.default_rng(7)
    z = np.stack([1e-3 * np.linspace(0.0, 1.0, 150), rng.standard_normal(150)], axis=1)
    r = accumulated(z)
    for _ in range(5):
        r = adaptation.running_inform(r, jnp.eye(2))
    result = adaptation.estimate(r, tuner().init(jnp.zeros(2), None).scale)
    sd = np.sqrt(np.diag(result.root @ result.root.T))
    assert sd[0] > 0.9  # it was 0.2 where the draws were taken for independent ones
    still = accumulated(np.ones((20, 2)))
    still = adaptation.running_inform(still, jnp.eye(2))
    assert np.all(np.isfinite(adaptation.estimate(still, result).root))


def covariance_of(t: Tuning) -> np.ndarray:
    return np.asarray(t.scale.root @ t.scale.root.T)


# A warm-up that is handed its draws: the adaptation alone, no kernel and no chance.

DIM, N = 2, 200


def draws() -> np.ndarray:
    rng = np.random.default_rng(3)
    return rng.standard_normal((N, DIM)) @ np.array([[2.0, 0.0], [0.6, 0.1]]) + [3.0, -1.0]


def information(z):
    """Differs from point to point, so that it shows at which it was taken."""
    return jnp.array([[2.0, 0.3], [0.3, 1.0]]) + jnp.outer(z, z)


def fed(tuner, z: np.ndarray, accept: float = 0.8, fisher_fn=None):
    """Every state (N + 1) and every trial (N) of a warm-up whose transition i leads to z[i]."""
    length = getattr(tuner, "longest", 0)
    record = trajectory.Record(
        jnp.full(length, accept), jnp.ones((length, 2 * DIM if length else 0))
    )
    no, zero = jnp.array(False), jnp.array(0)
    at = jnp.asarray(accept)
    info = trajectory.Info(at, no, no, no, at, zero, zero, record)
    total = jnp.array(len(z))

    def once(t, at):
        i, z = at
        k, params = tuner.trial(t, i, total)
        t = tuner.update(t, i, total, k, z, info, fisher_fn)
        return t, (t, k, params)

    first = tuner.init(jnp.zeros(DIM), None if fisher_fn is None else fisher_fn(jnp.zeros(DIM)))
    run = jax.jit(partial(jax.lax.scan, once))
    _, (states, k, params) = run(first, (jnp.arange(len(z)), jnp.asarray(z)))
    states = jax.tree.map(lambda a, b: np.concatenate([np.asarray(a)[None], b]), first, states)
    return states, np.asarray(k), params


def changes(x: np.ndarray) -> list[int]:
    """After how many transitions a quantity became another."""
    x = x.reshape(len(x), -1)
    return (1 + np.flatnonzero(np.any(x[1:] != x[:-1], axis=1))).tolist()


def tuner(**changed) -> Tuner:
    given = {
        "deltas": (0.5, 1.0, np.inf),
        "lengths": (1, 2, 4),
        "metric_cost": (3.0, 3.0, 0.0),
        "target": 0.8,
        "step_size": None,
        "covariance": None,
    }
    return Tuner(**(given | changed))


EDGE = [int(e * N) for e in EDGES]  # 10, 20, 40, 70, 100, 170
TURNS = [e for i, e in enumerate(EDGE) if i != NARROW]  # at which S and ε begin anew


@pytest.fixture(scope="module")
def warmed():
    return fed(tuner(), draws())


@pytest.mark.parametrize("fisher_fn", [None, information], ids=["draws alone", "informed"])
def test_each_window_sets_the_covariance(fisher_fn):
    """S changes at the edges and nowhere else, each time to that of the window's own draws."""
    z = draws()
    states, _, _ = fed(tuner(), z, fisher_fn=fisher_fn)
    assert changes(states.scale.root) == TURNS
    windows = [(0, 10), (10, 20), (20, 40), (40, 70), (40, 170)]
    for begin, end in windows:
        here = np.arange(begin, end)
        mean, weight = None, 5.0
        if fisher_fn is not None:
            informed = here[here % adaptation.INFORM_EVERY == 0]
            mean = np.mean([np.asarray(information(z[i])) for i in informed], axis=0)
            weight = (DIM + 5.0) * autocorrelation_length(z[begin:end], mean)
        want = shrunk(z[begin:end], mean, weight)
        t = jax.tree.map(lambda x, end=end: x[end], states)
        np.testing.assert_allclose(covariance_of(t), want, rtol=1e-10)
        np.testing.assert_allclose(t.scale.mean, z[begin:end].mean(axis=0), rtol=1e-10)


@pytest.mark.parametrize("fisher_fn", [None, information], ids=["draws alone", "informed"])
def test_haario_takes_all_draws_since_the_last_edge(fisher_fn):
    """At every transition, once there are more than 2 D draws; forgotten at 5, 10 and 20 %."""
    z = draws()
    states, _, _ = fed(Haario(0.234, None, None), z, accept=0.234, fisher_fn=fisher_fn)
    for end, begin in ((9, 0), (10, 0), (31, 20), (40, 20), (46, 40), (120, 40), (N, 40)):
        mean = None
        if fisher_fn is not None:
            informed = [i for i in range(begin, end) if i % adaptation.INFORM_EVERY == 0]
            mean = np.mean([np.asarray(information(z[i])) for i in informed], axis=0)
        want = shrunk(z[begin:end], mean, 5.0 if mean is None else 3 * DIM * (DIM + 5.0))
        t = jax.tree.map(lambda x, end=end: x[end], states)
        np.testing.assert_allclose(covariance_of(t), want, rtol=1e-10)
    kept = [x for x in range(1, N + 1) if x not in changes(states.scale.root)]
    assert kept == [*range(1, 5), *range(11, 15), *range(21, 25), *range(41, 45)]


def test_haario_is_numpys_covariance_in_the_end():
    """The imagined draws count for little: 5 in 10⁴, 3·10⁻⁷ of the larger variance each."""
    rng = np.random.default_rng(4)
    z = rng.standard_normal((12_500, DIM)) @ np.array([[2.0, 0.0], [0.6, 0.1]])
    states, _, _ = fed(Haario(0.234, None, None), z)
    t = jax.tree.map(lambda x: x[-1], states)
    np.testing.assert_allclose(covariance_of(t), np.cov(z[2500:].T), rtol=1e-3)
    np.testing.assert_allclose(t.scale.mean, z[2500:].mean(axis=0), rtol=1e-10)


def test_a_given_covariance_stays():
    given = np.array([[2.0, 0.3], [0.3, 1.0]])
    for one in (tuner(covariance=given), Haario(0.234, None, given)):
        states, _, _ = fed(one, draws(), fisher_fn=information)
        assert changes(states.scale.root) == []
        np.testing.assert_allclose(covariance_of(jax.tree.map(lambda x: x[0], states)), given)


def test_the_first_scale_is_the_inverse_information():
    at = jnp.array([0.4, -1.1])
    t = tuner().init(at, information(at))
    np.testing.assert_allclose(covariance_of(t), np.linalg.inv(information(at)), rtol=1e-12)
    np.testing.assert_array_equal(t.scale.mean, at)
    np.testing.assert_array_equal(covariance_of(tuner().init(at, None)), np.eye(2))
    np.testing.assert_array_equal(covariance_of(tuner().init(at, jnp.zeros((2, 2)))), np.eye(2))


# -------------------------------------------------------------------------- schedule


def test_candidates_take_turns_while_they_are_compared(warmed):
    states, k, params = warmed
    compare, narrow, settle = EDGE[COMPARE], EDGE[NARROW], EDGE[SETTLE]
    comparing = np.arange(compare, settle)
    np.testing.assert_array_equal(k[comparing], comparing % 3)
    num_steps = np.asarray(params.num_steps)
    assert set(num_steps[compare:narrow]) == {4}
    assert set(num_steps[narrow:settle]) == {2}  # all lengths jump as far: the shortest is best
    assert np.unique(k[:compare]).tolist() == [1]
    assert set(num_steps[:compare]) == {adaptation.FIRST_STEPS}
    winner = int(states.choice[-1])
    assert np.unique(k[settle:]).tolist() == [winner]
    np.testing.assert_array_equal(params.delta, np.array([0.5, 1.0, np.inf])[k])


def test_number_of_steps_follows_the_step_size():
    """After the comparison, so that a trajectory is as long in time as the one that won.

    Too few are accepted here, so that the step size falls.
    """
    states, _, params = fed(tuner(lengths=(1, 2, 16)), draws(), accept=0.6)
    settle = EDGE[SETTLE]
    time = states.time[settle]
    won = np.exp(states.steps.average[settle, 0])  # from which the step size begins anew
    np.testing.assert_allclose(time, states.num_steps[settle] * won)
    assert changes(states.time) == [settle]
    step_size = np.asarray(params.step_size)[settle:]
    np.testing.assert_array_equal(
        np.asarray(params.num_steps)[settle:], np.clip(np.round(time / step_size), 1, 16)
    )
    assert len(set(np.asarray(params.num_steps)[settle:])) > 1


def test_each_candidate_has_a_step_size_of_its_own(warmed):
    """Only the candidate whose turn it was moves, but at the edges, where all begin anew."""
    states, k, _ = warmed
    for i in sorted(set(range(N)) - {e - 1 for e in TURNS}):
        moved = states.steps.log_step[i + 1] != states.steps.log_step[i]
        assert not np.any(moved[np.arange(3) != k[i]])
    for edge in TURNS:
        assert np.ptp(states.steps.log_step[edge]) == 0
        assert np.all(states.steps.count[edge] == 0)
        before = states.steps.average[edge - 1][k[edge - 1]]
        # the last update of the window is in it: near where the window had got to
        assert abs(states.steps.log_step[edge][0] - before) < 0.5
    assert np.sum(states.steps.count[EDGE[SETTLE] - 1]) == EDGE[SETTLE] - EDGE[COMPARE] - 1


def test_only_the_comparison_is_scored(warmed):
    states, _, _ = warmed
    count = states.scores.count.sum(axis=1)  # (N + 1, L), over the candidates
    compare, narrow, settle = EDGE[COMPARE], EDGE[NARROW], EDGE[SETTLE]
    assert changes(count) == list(range(compare + 1, settle + 1))
    assert count[-1].tolist() == [settle - compare] * 2 + [narrow - compare] * 2


def test_what_is_given_is_not_touched():
    states, _, params = fed(tuner(step_size=0.37, lengths=(5,), deltas=(0.7,)), draws())
    np.testing.assert_allclose(params.step_size, 0.37, rtol=1e-12)
    assert set(np.asarray(params.num_steps)) == {5}
    assert set(np.asarray(params.delta)) == {0.7}
    assert changes(states.scale.root) == TURNS  # the rest adapts as ever


@pytest.mark.parametrize("num_warmup", [1, 7])
def test_any_warmup_ends_in_finite_numbers(num_warmup):
    for one in (tuner(), Haario(0.234, None, None)):
        states, _, _ = fed(one, draws()[:num_warmup], fisher_fn=information)
        params = one.params(jax.tree.map(lambda x: x[-1], states))
        assert np.isfinite(float(params.step_size))
        assert float(params.step_size) > 0
        assert int(params.num_steps) >= 1
        assert all(np.all(np.isfinite(x)) for x in params.scale)


# ----------------------------------------------------------------- choice of length and δ


def scored(jump, variance) -> adaptation.Scores:
    """Scores of 100 transitions per candidate with these mean jumps (K, L, F) and variances."""
    jump, variance = np.asarray(jump, float), np.asarray(variance, float)
    n = len(jump) * 100.0
    return adaptation.Scores(
        jnp.asarray(100.0 * jump),
        jnp.full(jump.shape[:2], 100.0),
        jnp.asarray(n * np.array([0.5, -1.0])),
        jnp.asarray(n * (variance + np.array([0.25, 1.0]))),
    )


def test_efficiency_is_that_of_a_first_order_chain():
    """Autocorrelations ρ of both features → min (1 − ρ)/(1 + ρ) over the cost, by hand."""
    rho = np.array([[[0.5, 0.9], [0.0, 0.2]], [[-0.5, -0.2], [0.8, 0.1]]])  # (δ, length, feature)
    variance = np.array([2.0, 5.0])
    cost = np.array([[1.0, 2.0], [4.0, 5.0]])
    result = adaptation.efficiency(scored(2 * variance * (1 - rho), variance), jnp.asarray(cost))
    want = np.min((1 - rho) / (1 + rho), axis=-1) / cost
    np.testing.assert_allclose(result, want, rtol=1e-12)


def test_a_chain_that_hardly_moves_is_not_thought_to_mix():
    """Jumps as large as its own spread, which is a thousandth of the posterior's."""
    tiny = np.array([1e-6, 1e-6])
    result = adaptation.efficiency(scored(2 * tiny[None, None], tiny), jnp.ones((1, 1)))
    assert float(result[0, 0]) < 1e-5


def gaussian_worth(step_size: float, lengths: np.ndarray) -> np.ndarray:
    """Efficiency per gradient of HMC on N(0, I) with M = I, by length: exact but for rejections.

    l leapfrog steps of a harmonic oscillator turn phase space by l θ, cos θ = 1 − ε²/2, so that x
    has lag-one autocorrelation cos lθ and x² cos² lθ; averaged over the jitter of ε.
    """
    u = np.linspace(-1, 1, 2001)
    theta = np.arccos(1 - (step_size * (1 + trajectory.JITTER * u)) ** 2 / 2)
    turn = np.cos(lengths[:, None] * theta)
    x, square = turn.mean(axis=1), (turn**2).mean(axis=1)
    return np.minimum((1 - x) / (1 + x), (1 - square) / (1 + square)) / lengths


@pytest.mark.parametrize(
    "step_size",
    [pytest.param(0.15, marks=pytest.mark.slow), 0.3, pytest.param(1.2, marks=pytest.mark.slow)],
)
def test_length_on_a_gaussian(step_size):
    """Given S and ε, warm-up takes a length that is hardly worse than the best in theory.

    In each of 8 chains, from some 500 noisy transitions. Twice the best length is worth less than a
    fifth of it.
    """
    lengths = np.arange(1, 1 + max(HMC._lengths))
    worth = gaussian_worth(step_size, lengths)
    assert worth[2 * np.argmax(worth) + 1] < 0.2 * worth.max()
    kernel = HMC(potential_fn=lambda z: 0.5 * z @ z, step_size=step_size, covariance=np.eye(2))
    result = np.asarray(warmed_up(kernel, 8, 1000).num_steps)
    assert np.all(worth[result - 1] > 0.6 * worth.max())


def warmed_up(kernel, chains: int, num_warmup: int, start=(0.0, 0.0)) -> Tuning:
    """What warm-up leaves in each of so many chains."""

    @jax.jit
    def run(keys):
        state = kernel.init(keys, num_warmup, jnp.broadcast_to(jnp.asarray(start), (chains, 2)))

        def step(state, _):
            return kernel.sample(state, (), {}), None

        return jax.lax.scan(step, state, length=num_warmup)[0].adapt_state

    return run(jax.random.split(jax.random.key(5), chains))
