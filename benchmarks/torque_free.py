"""Cost of a tumbling attitude and its derivatives, in closed form and by an integrator.

    python benchmarks/torque_free.py            into RESULTS.md

Median over bodies and motions from the prior of `lcbayes fit --spin torque-free`, with each
function repeated in one compiled loop. The integrator is the usual alternative: fourth-order
Runge–Kutta in one compiled scan, differentiated by JAX, with steps halved until the error of the
worst body is at most 10⁻⁶ rad.
"""

from __future__ import annotations

import numpy as np
from _results import table, write_section
from fisher import microseconds

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.physics.attitude import rotations
from lcbayes.physics.attitude.torque_free import torque_free_to_body

OMEGA_SD, SPAN, EPOCHS, BODIES = 0.01, 1200.0, 120, 9
RIGHT = 1e-6  # rad
TIMES = np.linspace(0.0, SPAN, EPOCHS)


def bodies() -> list[jax.Array]:
    """Bodies as ω over its prior's sd and the five components of S, (8,) each."""
    return [jnp.asarray(x) for x in np.random.default_rng(0).standard_normal((BODIES, 8))]


def tensor(x: jax.Array) -> jax.Array:
    """Inertia tensor from five components of S, as in `lcbayes.modelling.priors.inertia`."""
    a, b, c, d, e = x[3:]
    s = jnp.array([[a, c, d], [c, b, e], [d, e, -a - b]])
    values, axes = jnp.linalg.eigh(0.7 * s)
    moments = jnp.exp(values)
    return (axes * (jnp.sum(moments) - moments)) @ axes.T


def directions() -> tuple[jax.Array, ...]:
    v = np.random.default_rng(1).standard_normal((2, EPOCHS, 3))
    return tuple(jnp.asarray(x) for x in v / np.linalg.norm(v, axis=-1, keepdims=True))


SUN, OBS = directions()


def closed(x: jax.Array) -> jax.Array:
    seen = torque_free_to_body(jnp.asarray(TIMES), OMEGA_SD * x[:3], tensor(x), SUN, OBS)
    return jnp.stack(seen)


def integrated(x: jax.Array, steps: int) -> jax.Array:
    """Quaternion and body rates by ``steps`` Runge–Kutta steps between two epochs."""
    inertia = tensor(x)
    inverse = jnp.linalg.inv(inertia)

    def slope(y):
        q, w = y[:4], y[4:]
        turn = jnp.concatenate([-q[1:] @ w[None].T, q[0] * w + jnp.cross(q[1:], w)])
        return jnp.concatenate([0.5 * turn, inverse @ jnp.cross(inertia @ w, w)])

    h = (TIMES[1] - TIMES[0]) / steps

    def step(y, _):
        a = slope(y)
        b = slope(y + 0.5 * h * a)
        c = slope(y + 0.5 * h * b)
        return y + h / 6.0 * (a + 2.0 * b + 2.0 * c + slope(y + h * c)), None

    def epoch(y, _):
        return jax.lax.scan(step, y, None, steps)[0], y

    start = jnp.concatenate([jnp.array([1.0, 0.0, 0.0, 0.0]), OMEGA_SD * x[:3]])
    _, y = jax.lax.scan(epoch, start, None, EPOCHS)
    q = y[:, :4] / jnp.linalg.norm(y[:, :4], axis=1, keepdims=True)
    r, v = q[:, :1, None], q[:, 1:]
    outer = v[:, :, None] * v[:, None, :]
    zero = jnp.zeros(EPOCHS)
    cross = jnp.stack(
        [zero, -v[:, 2], v[:, 1], v[:, 2], zero, -v[:, 0], -v[:, 1], v[:, 0], zero], axis=1
    ).reshape(-1, 3, 3)
    square = jnp.sum(v**2, axis=1)[:, None, None]
    rotation = (r**2 - square) * jnp.eye(3) + 2.0 * outer + 2.0 * r * cross
    return jnp.stack([rotations.to_body(rotation, u) for u in (SUN, OBS)])


def sufficient_steps() -> int:
    """Steps between two epochs at which the worst body reaches the required accuracy."""
    steps = 1
    while True:
        off = max(float(jnp.abs(jax.jit(closed)(x) - _run(x, steps)).max()) for x in bodies())
        print(f"{steps} steps between epochs: {off:.1e} rad", flush=True)
        if off < RIGHT:
            return steps
        steps *= 2


def _run(x: jax.Array, steps: int) -> jax.Array:
    return jax.jit(integrated, static_argnums=1)(x, steps)


def main() -> None:
    steps = sufficient_steps()
    methods = {"closed form": closed, "integrator": lambda x: integrated(x, steps)}
    rows, all_took = [], []
    for name, seen in methods.items():
        functions = {
            "value": seen,
            "gradient": jax.grad(lambda x, seen=seen: jnp.sum(seen(x) ** 3)),
            "Jacobian": jax.jacfwd(seen),
        }
        took = [
            float(np.median([microseconds(f, x) for x in bodies()])) for f in functions.values()
        ]
        all_took.append(took)
        rows.append([name, *(f"{x:.3g}" for x in took)])
        print(rows[-1], flush=True)
    ours, theirs = all_took
    rows.append(["ratio", *(f"{b / a:.1f}" for a, b in zip(ours, theirs, strict=True))])
    text = (
        f"Directions to Sun and observer at {EPOCHS} epochs in {SPAN:.0f} s, ω ~ N(0, {OMEGA_SD}² "
        f"I) rad/s, median of {BODIES} bodies; derivatives by ω and inertia, eight in all. "
        f"The integrator takes {steps} steps between epochs to be right to {RIGHT:g} rad in the "
        "worst of them; the closed form is right to rounding, however late.\n\n"
    )
    text += table(["way", "value (µs)", "gradient (µs)", "Jacobian (µs)"], rows)
    write_section("Cost of a tumbling attitude", "python benchmarks/torque_free.py", text)


if __name__ == "__main__":
    main()
