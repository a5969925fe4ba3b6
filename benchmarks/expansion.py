"""Error and cost of the brightness expanded about the solution of a fit.

    lcbayes fit 43_Ariadne_rel.lcs --model convex-grid --period 5.762h -o DIR
    python benchmarks/expansion.py DIR ...

For fits of asteroids (`convex-grid`) and of known bodies (`body`): ln posterior of draws of the
most probable solution, with the brightness expanded about their mean, against the exact one, at the
power of the likelihood that correlated residuals leave. A constant difference changes nothing. The
cost is that of a gradient, compiled, the least of many.
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
from lcbayes.results.light_curve import load_light_curve

DRAWS, REPEATS = 200, 100


def gradient_ms(problem: Problem, z: np.ndarray, data: Epochs) -> float:
    f, at, best = jax.jit(jax.value_and_grad(problem.potential)), jnp.asarray(z), np.inf
    for _ in range(REPEATS):
        begun = time.perf_counter()
        jax.block_until_ready(f(at, data))
        best = min(best, time.perf_counter() - begun)
    return 1e3 * best


def row_of(folder: Path) -> list[str]:
    fit = lcbayes.load(folder)
    data = Epochs.of(load_light_curve(fit.data))
    entry = registry.find(fit.content["model"])
    options = entry.check(fit.content["model_options"])
    problem = build_problem(entry, options, data)[1]
    posterior = fit.data["modes/0/posterior"]
    flat = {k: np.asarray(posterior[k]) for k in problem.names}
    flat = {k: v.reshape(-1, *v.shape[2:]) for k, v in flat.items()}
    rows = np.linspace(0, len(flat[problem.names[0]]) - 1, DRAWS).astype(int)
    z = np.stack([problem.ravel({k: jnp.asarray(v[i]) for k, v in flat.items()}) for i in rows])
    data = tempered(problem, z[0], data)
    hook = entry.hook("guide")
    guide = None if hook is None else hook(problem, data, **options)
    if guide is None:
        raise SystemExit(f"{folder}: its model has no expansion, or its gradient is cheap")
    about = guide(z.mean(axis=0))
    change = potentials(problem, z, about) - potentials(problem, z, data)
    exact, expanded = (gradient_ms(problem, z[0], x) for x in (data, about))
    row = [folder.name, fit.content["model"], str(data.t.size), str(problem.dim)]
    row += [f"{change.std():.3f}", f"{np.ptp(change):.2f}"]
    return [*row, f"{exact:.2f}", f"{expanded:.2f}", f"{exact / expanded:.1f}"]


def main() -> None:
    parser = argparse.ArgumentParser(description="Compare an expansion with the exact brightness.")
    parser.add_argument("fits", type=Path, nargs="+", help="results folders of fits")
    folders = parser.parse_args().fits
    heads = ["fit", "model", "points", "D", "sd of the error of ln posterior", "its range"]
    heads += ["exact gradient (ms)", "expanded (ms)", "ratio"]
    text = f"{DRAWS} draws.\n\n" + table(heads, [row_of(folder) for folder in folders])
    names = " ".join(folder.name for folder in folders)
    write_section("Expanded brightness", f"python benchmarks/expansion.py {names}", text)


if __name__ == "__main__":
    main()
