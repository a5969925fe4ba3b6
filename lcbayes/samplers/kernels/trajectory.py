"""One Metropolis-corrected trajectory of any reversible, volume-preserving integrator."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from lcbayes.core.jax_setup import jax, jnp

MAX_ENERGY_ERROR = 1000.0  # nats: a trajectory with a larger error is divergent, as in Stan
JITTER = 0.2  # relative half-width of the uniform jitter of the step size


class State(NamedTuple):
    """Current point of a chain."""

    z: jax.Array  # (D,)
    potential: jax.Array
    grad: jax.Array  # (D,)


class Record(NamedTuple):
    """Acceptance and jumps for each length of a trajectory; filled during warm-up only."""

    accept: jax.Array  # (L,) acceptance probability after l + 1 steps
    jump: jax.Array  # (L, K) acceptance times squared jump of each feature


class Info(NamedTuple):
    """Statistics of one transition."""

    accept_prob: jax.Array
    diverging: jax.Array  # energy error above MAX_ENERGY_ERROR, or not finite
    failed: jax.Array  # an implicit step or its reverse did not converge
    fallback: jax.Array  # the metric was singular or not finite, and the frozen one was used
    energy: jax.Array
    num_steps: jax.Array  # gradients of the potential
    num_metric: jax.Array  # Fisher matrices; a derivative along one direction counts as one
    record: Record


class Point(NamedTuple):
    """A point of phase space along a trajectory."""

    z: jax.Array  # (D,)
    v: jax.Array  # (D,) momentum, whitened where the metric is constant
    potential: jax.Array
    grad: jax.Array  # (D,) of the potential alone
    solved: jax.Array  # False once an implicit step has failed
    extra: Any = ()  # data that an integrator passes from step to step


class Dynamics(NamedTuple):
    """An integrator step(point, ε) -> point and the conserved energy(point)."""

    step: Callable[[Point, jax.Array], Point]
    energy: Callable[[Point], jax.Array]


def init(z: jax.Array, potential_fn: Callable[[jax.Array], jax.Array]) -> State:
    """The state of a chain at z (D,)."""
    return State(z, *jax.value_and_grad(potential_fn)(z))


def jittered(key: jax.Array, step_size: jax.Array) -> jax.Array:
    """ε (1 + 0.2 u), u ~ U(−1, 1), independent of the state, so that the rule remains exact."""
    return step_size * (1 + JITTER * jax.random.uniform(key, minval=-1.0, maxval=1.0))


def features(z: jax.Array, mean: jax.Array, sd: jax.Array) -> jax.Array:
    """Standardised coordinates and their squares, (2 D,), by which mixing is measured."""
    y = (z - mean) / sd
    return jnp.concatenate([y, y * y])


def run(
    key: jax.Array,
    dynamics: Dynamics,
    start: Point,
    step_size: jax.Array,
    num_steps: jax.Array,
    feature_fn: Callable[[jax.Array], jax.Array] | None = None,
    record_steps: int = 0,
) -> tuple[Point, Info, Point]:
    """L steps, accepted with probability min{1, exp(H − H′)}: new point, info and end point.

    A trajectory stops early and is rejected if the energy is not finite or an implicit step fails.
    The reverse trajectory would reach the same point, so detailed balance holds.
    """
    before = dynamics.energy(start)
    first = feature_fn(start.z) if feature_fn else jnp.zeros(0)
    record = Record(jnp.zeros(record_steps), jnp.zeros((record_steps, first.shape[0])))

    def alive(carry):
        l, point, _ = carry
        return (l < num_steps) & point.solved & jnp.isfinite(point.potential)

    def advance(carry):
        l, point, record = carry
        point = dynamics.step(point, step_size)
        if feature_fn:
            accept = _accept(before, dynamics.energy(point), point.solved)
            jump = jnp.where(accept > 0, accept * (feature_fn(point.z) - first) ** 2, 0.0)
            record = Record(record.accept.at[l].set(accept), record.jump.at[l].set(jump))
        return l + 1, point, record

    taken, end, record = jax.lax.while_loop(alive, advance, (jnp.array(0), start, record))
    after = dynamics.energy(end)
    accept = jnp.where(taken == num_steps, _accept(before, after, end.solved), 0.0)
    accepted = jax.random.uniform(key) < accept
    point = jax.tree.map(lambda a, b: jnp.where(accepted, a, b), end, start)
    error = after - before
    info = Info(
        accept_prob=accept,
        diverging=end.solved & ~(error < MAX_ENERGY_ERROR),
        failed=~end.solved,
        fallback=jnp.array(False),
        energy=jnp.where(accepted, after, before),
        num_steps=taken,
        num_metric=jnp.array(0),
        record=record,
    )
    return point, info, end


def _accept(before: jax.Array, after: jax.Array, solved: jax.Array) -> jax.Array:
    probability = jnp.exp(jnp.minimum(before - after, 0.0))
    return jnp.where(solved & jnp.isfinite(after), probability, 0.0)
