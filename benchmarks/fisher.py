"""Cost of a Fisher matrix relative to a gradient of the posterior.

    python benchmarks/fisher.py            into RESULTS.md

Rotating facets observed at 300 epochs, and the posteriors of samplers.py. Each function is repeated
in one compiled loop, so that only the computation is timed. The dense matrix does not exploit
structure: it uses forward mode through the whole model, with a column for every parameter.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from _posteriors import POSTERIORS
from _results import table, write_section

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.data.lightcurve import LightCurve
from lcbayes.modelling import registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem

EPOCHS = 300
REPEATED, TIMED = 200, 7


def curve() -> LightCurve:
    """Rotating directions and a sinusoidal brightness, whose values do not matter here."""
    t = np.linspace(0.0, 600.0, EPOCHS)

    def directions(rate: float, tilt: float) -> np.ndarray:
        v = np.stack([np.cos(rate * t), np.sin(rate * t), tilt + 0.0 * t], axis=1)
        return v / np.linalg.norm(v, axis=1, keepdims=True)

    return LightCurve(
        t=t,
        brightness=2.0 + np.sin(t / 40.0),
        error=np.full(EPOCHS, 0.05),
        sun=directions(1e-3, 0.3),
        obs=directions(0.02, -0.2),
        kind="flux",
    )


def microseconds(f: Callable[..., Any], z: jax.Array, *args: Any) -> float:
    """Time of one evaluation (µs), the median of several loops after one to compile."""

    def body(_: Any, z: jax.Array) -> jax.Array:
        return z + 1e-12 * sum(jnp.sum(x) for x in jax.tree.leaves(f(z, *args)))

    loop = jax.jit(lambda z: jax.lax.fori_loop(0, REPEATED, body, z))
    times = []
    for _ in range(TIMED + 1):
        begun = time.perf_counter()
        jax.block_until_ready(loop(z))
        times.append(time.perf_counter() - begun)
    return float(1e6 * np.median(times[1:]) / REPEATED)


def dense(problem: Problem, z: jax.Array, data: Epochs) -> jax.Array:
    """JᵀWJ by forward mode over all parameters."""
    jacobian = jax.jacfwd(lambda z: problem.moments(z, data).mean)(z)
    return jacobian.T @ (jacobian / data.error[:, None] ** 2)


def row(what: str, dim: int, gradient: float, fisher: float, plain: str) -> list[str]:
    times = [f"{x:.3g}" for x in (gradient, fisher)]
    return [what, str(dim), *times, f"{fisher / gradient:.1f}", plain]


def main() -> None:
    rows = []
    data = Epochs.of(curve())
    for n_facets in (1, 2, 6, 10):
        problem = Problem(registry.find("faceted").bind({"n_facets": n_facets}), data)
        z = jax.jit(problem.prior_draw)(jax.random.key(0), data)
        took = [
            microseconds(f, z, data)
            for f in (
                jax.value_and_grad(problem.potential),
                problem.fisher,
                partial(dense, problem),
            )
        ]
        what = f"{n_facets} facets × {EPOCHS} epochs, ω"
        rows.append(row(what, problem.dim, took[0], took[1], f"{took[2] / took[0]:.1f}"))
        print(rows[-1], flush=True)
    for title, make in POSTERIORS.values():
        post = make()
        y = jnp.zeros(post.dim)
        took = [
            microseconds(f, y, *post.args)
            for f in (jax.value_and_grad(post.potential), post.fisher)
        ]
        rows.append(row(title, post.dim, took[0], took[1], "–"))
        print(rows[-1], flush=True)
    heads = [
        "posterior",
        "D",
        "gradient (µs)",
        "Fisher (µs)",
        "in gradients",
        "dense, in gradients",
    ]
    write_section(
        "Cost of the Fisher information",
        "python benchmarks/fisher.py",
        f"With the prior's precision. Goal: at most 3 gradients for 6 facets × 300 epochs.\n\n"
        f"{table(heads, rows)}",
    )


if __name__ == "__main__":
    main()
