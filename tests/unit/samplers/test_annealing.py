"""Ratios of evidences by annealing, for densities whose integrals are known."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.samplers import annealing

APART = 100.0  # distance of the two solutions along the first coordinate
RATIO = 0.05  # of their evidences
SD = np.array([[1.0, 2.0, 0.3], [0.2, 0.1, 0.9]])
LOBES = np.array([[0.4, 0.6], [0.8, 0.2]])  # shares of the arrangements of each solution
BETWEEN = 1.6  # sd between the arrangements and the middle, along the second coordinate


@dataclass(frozen=True)
class TwoSolutions:
    """Two solutions, each of two Gaussian lobes, with evidences of 1 and `RATIO`."""

    dim: int = 3

    def potential(self, z, data):  # noqa: ARG002
        each = []
        for k, weight in enumerate((1.0, RATIO)):
            for share, side in zip(LOBES[k], (-1.0, 1.0), strict=True):
                away = (z - centre(k, side)) / SD[k]
                log_density = -0.5 * jnp.sum(away**2 + np.log(2 * np.pi)) - np.log(SD[k]).sum()
                each.append(np.log(weight * share) + log_density)
        return -jax.nn.logsumexp(jnp.stack(each))

    def fisher(self, z, data):  # noqa: ARG002
        return jnp.diag(jnp.where(z[0] < 0.5 * APART, *(1.0 / SD**2)))


def centre(k, side):
    return np.array([APART * k, side * BETWEEN * SD[k, 1], 0.0])


def draws(k, rng, n=1600):
    side = rng.choice([-1.0, 1.0], n, p=LOBES[k])
    middle = np.stack([centre(k, one) for one in side])
    return middle + SD[k] * rng.standard_normal((n, 3))


def measured(away, seed=0):
    """The ratio by a map with the right widths that misses the second solution by so many sd."""
    rng = np.random.default_rng(seed)
    problem: Any = TwoSolutions()
    scale = SD[1] / SD[0]
    shift = np.array([APART, 0.0, 0.0]) + away * SD[1]
    data: Any = None
    key = jax.random.key(seed)
    ends = draws(0, rng), draws(1, rng)
    return annealing.log_ratio(problem, data, *ends, np.diag(scale), shift, key, 2)


@pytest.mark.parametrize("away", [0.0, 4.0])
def test_the_ratio_of_two_evidences(away):
    """The shares of the arrangements differ, and the map may be poor."""
    found = measured(away)
    assert found.se < 0.4
    assert abs(found.value - np.log(RATIO)) < 3.0 * found.se


@pytest.mark.slow
def test_errors_are_as_stated():
    """Of twelve ratios at most one is off by more than twice its error."""
    found = [measured(3.0, seed) for seed in range(12)]
    off = [abs(one.value - np.log(RATIO)) > 2.0 * one.se for one in found]
    assert sum(off) <= 1


def test_particles_that_do_not_arrive_have_no_ratio(monkeypatch):
    """The error is infinite, so that the weight that follows from it is not used."""
    monkeypatch.setattr(annealing, "MAX_STAGES", 1)
    found = measured(4.0)
    assert found.value == -np.inf
    assert found.se == np.inf


def test_too_uncertain_ratios_are_measured_again(monkeypatch):
    """Six transitions at each step instead of two bring both directions nearer to each other."""
    monkeypatch.setattr(annealing, "TRANSITIONS", (2,))
    once = measured(4.0)
    monkeypatch.setattr(annealing, "TRANSITIONS", (2, 6))
    monkeypatch.setattr(annealing, "ENOUGH", 0.99 * once.se)
    again = measured(4.0)
    assert again != once
    assert abs(again.value - np.log(RATIO)) < 3.0 * again.se
