"""Levenberg-Marquardt from many starts: where are the solutions?

Fisher scoring with damping on the whole posterior: the metric is the Fisher information of the
data plus the prior's precision, so the same routine serves every model and noise law.
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

from lcbayes._jax import jax, jnp
from lcbayes.epochs import Epochs
from lcbayes.inference.problem import Problem


class SearchState(NamedTuple):
    """One start per row."""

    z: jax.Array  # (B, D)
    potential: jax.Array  # (B,)
    damping: jax.Array  # (B,)
    stalled: jax.Array  # (B,) steps in a row that gained less than the tolerance


def init(problem: Problem, z: jax.Array, data: Epochs) -> SearchState:
    """State of a search from the starts z (B, D)."""
    potential = jax.vmap(problem.potential, (0, None))(z, data)
    potential = jnp.where(jnp.isfinite(potential), potential, jnp.inf)
    return SearchState(z, potential, jnp.full(len(z), 1.0), jnp.zeros(len(z), int))


def _step(problem: Problem, data: Epochs, state: SearchState) -> SearchState:
    """One damped step of one start; rejected steps raise the damping."""
    z, old, damping, stalled = state
    gradient = jax.grad(problem.potential)(z, data)
    metric = problem.fisher(z, data)
    scale = jnp.diagonal(metric)
    step = jnp.linalg.solve(metric + jnp.diag(damping * scale + 1e-10), -gradient)
    trial = z + step
    new = problem.potential(trial, data)
    better = jnp.isfinite(new) & (new < old)
    gain = jnp.where(better, old - new, 0.0)
    return SearchState(
        jnp.where(better, trial, z),
        jnp.where(better, new, old),
        jnp.clip(jnp.where(better, damping / 5.0, damping * 4.0), 1e-9, 1e9),
        jnp.where(better & (gain < 1e-2), stalled + 1, 0) + jnp.where(damping > 1e8, 3, 0),
    )


@partial(jax.jit, static_argnums=(0, 3))
def advance(problem: Problem, data: Epochs, state: SearchState, n_steps: int) -> SearchState:
    """``n_steps`` damped steps of every start; starts that have stalled stay where they are."""

    def one(row: SearchState) -> SearchState:
        def cond(carry):
            i, s = carry
            return (i < n_steps) & (s.stalled < 3)

        def body(carry):
            i, s = carry
            return i + 1, _step(problem, data, s)

        return jax.lax.while_loop(cond, body, (0, row))[1]

    return jax.lax.map(one, state)
