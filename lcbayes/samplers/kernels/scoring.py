"""Damped Fisher scoring: the path of a chain from a prior draw to the posterior's typical set."""

from __future__ import annotations

from collections.abc import Callable

from lcbayes.core.jax_setup import jax
from lcbayes.core.levenberg_marquardt import Quadratic, levenberg_marquardt

MAX_STEPS = 100
TOLERANCE = 1e-2  # nats


def ascend(
    potential_fn: Callable[[jax.Array], jax.Array],
    fisher_fn: Callable[[jax.Array], jax.Array],
    z: jax.Array,
) -> jax.Array:
    """The point (D,) that at most `MAX_STEPS` Levenberg–Marquardt steps from z reach.

    A chain that starts at a prior draw with a misfit of 10⁴ nats would spend most of its warm-up on
    this path, in steps of a hundredth of a posterior width.
    """
    value_and_grad = jax.value_and_grad(potential_fn)

    def model(z: jax.Array) -> Quadratic:
        return Quadratic(*value_and_grad(z), fisher_fn(z))

    end = levenberg_marquardt(model, z, num_steps=MAX_STEPS, tolerance=TOLERANCE, damping=1.0)
    return end.position
