"""When chains are long enough, and when to give up hope."""

from __future__ import annotations

from contextlib import contextmanager

import numpy as np
import pytest

import lcbayes
from lcbayes.core.progress import Silent
from lcbayes.samplers.convergence import MIN_ESS, required_length, rhat_and_ess
from lcbayes.samplers.sampling import Sampler
from lcbayes.samplers.settings import MANY_DRAWS, MAX_DRAWS, Settings
from tests.helpers import small_curves


def autoregressive(memory: float, n: int = 750, chains: int = 4) -> np.ndarray:
    """Unit Gaussians of which n are worth n (1 − memory)/(1 + memory), (C, n, 2)."""
    rng = np.random.default_rng(0)
    z = rng.standard_normal((chains, n, 2))
    for i in range(1, n):
        z[:, i] = memory * z[:, i - 1] + np.sqrt(1 - memory**2) * z[:, i]
    return z


def test_worth_of_draws_of_known_memory():
    rhat, size = rhat_and_ess(autoregressive(0.9, 20_000))
    assert size == pytest.approx(80_000 * 0.1 / 1.9, rel=0.15)
    assert 1.0 <= rhat < 1.01


def test_enough_draws_are_left_alone():
    z = autoregressive(0.0)
    assert required_length(z, 3000) == 750
    assert required_length(autoregressive(0.9), 750) == 750  # as many as were asked for


@pytest.mark.parametrize("memory", [0.85, 0.9])
def test_too_few_draws_ask_for_what_is_missing(memory):
    z = autoregressive(memory)
    _, size = rhat_and_ess(z)
    assert size < MIN_ESS
    n = required_length(z, 3000)
    assert 4 / 3 * 750 <= n <= 1500
    assert n * size / 750 > MIN_ESS or n == 1500
    longer = required_length(autoregressive(memory, n), 3000)
    assert rhat_and_ess(autoregressive(memory, longer))[1] > MIN_ESS


def test_chains_that_will_not_converge_cost_no_more():
    assert required_length(autoregressive(0.99), 3000) == 750  # worth 15
    z = autoregressive(0.9)
    separate = z + np.arange(4.0)[:, None, None]
    assert required_length(separate, 3000) == 750
    assert required_length(np.zeros((4, 750, 2)), 3000) == 750  # stuck
    assert required_length(z[:1], 3000) == 750  # one chain, which nothing can be compared with


def test_few_draws_of_a_long_run_are_not_given_up():
    """Their effective size varies too much: 750 of 12,000 draws may look hopeless by chance."""
    z = autoregressive(0.99)
    assert required_length(z, 12_000) == 1500
    assert required_length(z + 0.5 * np.arange(4.0)[:, None, None], 12_000) == 1500
    assert required_length(autoregressive(0.98, 3000), 12_000) > 3000
    assert required_length(autoregressive(0.99, 3000), 12_000) == 3000  # enough to tell
    assert required_length(z + 5.0 * np.arange(4.0)[:, None, None], 12_000) == 750
    assert required_length(np.zeros((4, 750, 2)), 12_000) == 750


def test_chains_that_disagree_about_a_direction_are_extended():
    """The spread of the length of the vector hides what R-hat of the polar angle shows."""
    problem, data = small_curves.posterior(small_curves.curve(20), n_facets=1, spin="none")
    rng = np.random.default_rng(0)
    centre = np.asarray(small_curves.truth(problem, data, 1))
    z = centre + 0.01 * rng.standard_normal((4, 750, problem.dim))
    rows = problem.rows(["normals_base"])
    polar = small_curves.NORMALS[0, 2]
    shift = 0.0015 * np.array([-1.0, 1.0, -1.0, 1.0])[:, None]
    level = np.sqrt((1 - (polar + shift) ** 2) / (1 - polar**2))
    v = np.broadcast_to(small_curves.NORMALS[0], (4, 750, 3)).copy()
    v = np.concatenate([v[..., :2] * level[..., None], v[..., 2:] + shift[..., None]], axis=-1)
    v += 0.01 * rng.standard_normal(v.shape)
    length = 1 + 0.1 * rng.standard_normal((4, 750, 1))
    z[..., rows] = length * v / np.linalg.norm(v, axis=-1, keepdims=True)
    polar = v[..., 2:] / np.linalg.norm(v, axis=-1, keepdims=True)
    assert required_length(z, 3000) == 750
    assert required_length(polar, 3000, margin=1.0) > 750
    settings = Settings(num_warmup=50)
    assert Sampler(problem, settings, 1)._required_length(z, data) > 750
    assert Sampler(problem, settings, 1)._required_length(z[..., ::-1, :][:1], data) == 750


@pytest.mark.parametrize(("n", "kept"), [(750, 750), (3000, 3000), (4500, 2250), (12_050, 3000)])
def test_long_chains_are_thinned(n, kept):
    problem, _ = small_curves.posterior(small_curves.curve(20), n_facets=1, spin="none")
    settings = Settings().with_sampler("facet-moves")
    sampler = Sampler(problem, Settings(), 1)
    sampler.settings = settings
    rows = np.arange(n)[sampler._kept(n)]
    assert len(rows) == kept
    assert np.all(np.diff(rows) == rows[1] - rows[0])
    asked = Sampler(problem, Settings(num_samples=5000), 1)
    assert np.arange(5000)[asked._kept(5000)].size == 5000


def test_who_asks_for_a_number_gets_it():
    assert Settings().most_samples == MAX_DRAWS
    assert Settings().with_sampler("facet-moves").most_samples == MANY_DRAWS["facet-moves"]
    assert Settings(num_samples=500).with_sampler("facet-moves").most_samples == 500
    assert Settings(num_samples=500).most_samples == 500
    assert Settings(sampler="smc").most_samples == Settings(sampler="smc").num_samples


@pytest.mark.parametrize("asked", [{}, {"num_samples": 750}, {"sampler": "smc"}, {"sampler": "mh"}])
def test_settings_are_recorded_as_they_were_asked_for(asked):
    """So that a run from its run.toml goes on as the first one did."""
    settings = Settings(**asked)
    assert Settings(**settings.as_dict()) == settings
    assert settings.as_dict() != Settings(num_samples=1000).as_dict()


class Cut(Silent):
    """Stops a run that goes on, at its first block beyond what was announced."""

    @contextmanager
    def stage(self, title, total, unit):  # noqa: ARG002
        yield self

    def __init__(self) -> None:
        self.longer = False

    def more(self, n: int) -> None:
        self.longer |= n > 0

    def advance(self, n: int, note: str = "") -> None:  # noqa: ARG002
        if self.longer:
            raise KeyboardInterrupt


def test_a_fit_goes_on_until_it_has_enough_and_so_it_does_when_resumed(tmp_path, monkeypatch):
    """Begun with 100 draws a chain, which no posterior has 400 independent ones of."""
    monkeypatch.setattr("lcbayes.samplers.settings.DRAWS", 100)
    curve = small_curves.curve(20, noise=0.1)
    asked = {"n_facets": 1, "spin": "none", "num_warmup": 100, "num_starts": 24, "seed": 3}
    whole = lcbayes.fit(curve, **asked)
    assert 100 < whole.posterior.sizes["draw"] <= MAX_DRAWS
    assert whole.content["min_ess_bulk"] >= MIN_ESS
    with pytest.raises(KeyboardInterrupt):
        lcbayes.fit(curve, out=tmp_path, progress=Cut(), **asked)
    resumed = lcbayes.fit(curve, out=tmp_path, **asked)
    np.testing.assert_array_equal(resumed.posterior["g"], whole.posterior["g"])
