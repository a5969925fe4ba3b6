"""Error and cost of the brightness of an asteroid expanded about a solution.

    lcbayes fit CURVE --model convex-grid --period 5.762 -o DIR
    python benchmarks/expansion.py CURVE 5.762 DIR

ln posterior of draws of the most probable solution in DIR, with the brightness expanded about their
mean, against the exact one, at the power of the likelihood that the correlated residuals leave. A
constant difference changes nothing. The cost is that of a gradient, compiled, the least of many.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
from _results import table, write_section

import lcbayes
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.inference.correlation import tempered
from lcbayes.inference.problem_cache import build_problem
from lcbayes.modelling import registry
from lcbayes.modelling.constrained import potentials
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.models import convex_grid

DRAWS, REPEATS = 200, 100


def gradient_ms(problem: Problem, z: np.ndarray, data: Epochs) -> float:
    f, at, best = jax.jit(jax.value_and_grad(problem.potential)), jnp.asarray(z), np.inf
    for _ in range(REPEATS):
        begun = time.perf_counter()
        jax.block_until_ready(f(at, data))
        best = min(best, time.perf_counter() - begun)
    return 1e3 * best


def main() -> None:
    parser = argparse.ArgumentParser(description="Compare an expansion with the exact brightness.")
    parser.add_argument("curve", type=Path)
    parser.add_argument("period", type=float)
    parser.add_argument("fit", type=Path)
    given = parser.parse_args()
    data = Epochs.of(lcbayes.read(given.curve))
    entry = registry.find("convex-grid")
    defaults = {o.name: o.default for o in entry.options.values()}
    options = entry.check(defaults | {"period": given.period})
    problem = build_problem(entry, options, data)[1]
    posterior = lcbayes.load(given.fit).data["modes/0/posterior"]
    flat = {k: np.asarray(posterior[k]).reshape(-1, *posterior[k].shape[2:]) for k in problem.names}
    rows = np.linspace(0, len(flat["pole_base"]) - 1, DRAWS).astype(int)
    z = np.stack([problem.ravel({k: jnp.asarray(v[i]) for k, v in flat.items()}) for i in rows])
    data = tempered(problem, z[0], data)
    guide = convex_grid.guide(problem, data, **options)
    if guide is None:
        raise SystemExit(f"{given.curve.name}: too few points for an expansion")
    about = guide(z.mean(axis=0))
    change = potentials(problem, z, about) - potentials(problem, z, data)
    exact, expanded = (gradient_ms(problem, z[0], x) for x in (data, about))
    row = [str(data.t.size), f"{change.std():.2f}", f"{np.ptp(change):.2f}"]
    row += [f"{exact:.2f}", f"{expanded:.2f}", f"{exact / expanded:.1f}"]
    heads = ["points", "sd of the error of ln posterior", "its range"]
    heads += ["exact gradient (ms)", "expanded (ms)", "ratio"]
    title = f"Asteroids: expanded brightness, {given.curve.stem}"
    command = f"python benchmarks/expansion.py {given.curve.name} {given.period:g} DIR"
    write_section(title, command, f"{DRAWS} draws.\n\n" + table(heads, [row]))


if __name__ == "__main__":
    main()
