"""Time to trace a posterior and its gradient once more, beside NumPyro's own potential.

python benchmarks/tracing.py

A search or a sampler differentiates and batches the same posterior in many programs, and each has
to be traced before it is compiled or found in the cache. NumPyro runs the model each time.
Processor time, median of several repetitions after one that is not counted.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from _results import table, write_section
from numpyro.infer.util import potential_energy

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.data.lightcurve import LightCurve
from lcbayes.modelling import registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem

CASES: list[tuple[str, dict[str, Any]]] = [
    ("faceted", {"n_facets": 3}),
    ("faceted", {"n_facets": 3, "spin": "torque-free"}),
    ("faceted-brdf", {}),
    ("convex-grid", {"period": 0.02}),
    ("stabilised", {"law": "inertial"}),
    ("body", {"body": "rocket-stage"}),
]
REPETITIONS, EPOCHS = 7, 60


def light_curve() -> LightCurve:
    """Two directions that turn against one another, and a brightness without meaning."""
    angle = np.linspace(0.0, 2.0, EPOCHS)
    sun = np.tile([1.0, 0.0, 0.0], (EPOCHS, 1))
    obs = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    flux = 3.0 + np.cos(5.0 * angle)
    error = np.full(EPOCHS, 0.1)
    return LightCurve(t=60.0 * angle, brightness=flux, error=error, sun=sun, obs=obs, kind="flux")


def seconds(potential: Callable[[Any], Any], z: Any) -> float:
    """Processor time to trace a function and its gradient, each time as a new function."""
    took = []
    for _ in range(REPETITIONS + 1):
        begun = time.process_time()
        jax.make_jaxpr(jax.value_and_grad(lambda z: potential(z)))(z)
        took.append(time.process_time() - begun)
    return statistics.median(took[1:])


def main() -> None:
    data, rows = Epochs.of(light_curve()), []
    for name, given in CASES:
        entry = registry.find(name)
        problem = Problem(entry.bind(entry.check(given)), data)
        z = jnp.full(problem.dim, 0.1)
        ours = seconds(lambda z, p=problem: p.potential(z, data), z)
        theirs = seconds(
            lambda z, p=problem: potential_energy(p.model, (data,), {}, z), problem.unravel(z)
        )
        options = " ".join(f"{k}={v}" for k, v in given.items())
        rows.append([f"{name} {options}", f"{theirs:.3f}", f"{ours:.3f}", f"{theirs / ours:.0f}"])
        print(*rows[-1], flush=True)
    heads = ["model", "NumPyro (s)", "lcbayes (s)", "ratio"]
    write_section("Tracing a posterior again", "python benchmarks/tracing.py", table(heads, rows))


if __name__ == "__main__":
    main()
