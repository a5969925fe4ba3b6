"""Speed of particle moves with and without BLAS multithreading.

python benchmarks/blas_threads.py        into RESULTS.md

256 particles from the prior make one move each (`lcbayes.samplers.moves`) on two threads, first
with `concurrent.futures`, then with `lcbayes.core.threads`.
"""

from __future__ import annotations

import time
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import AbstractContextManager

import numpy as np
from _results import table, write_section
from facet_count import turning

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.threads import threads
from lcbayes.modelling import registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.samplers import moves, tempering_path

PARTICLES, REPEATS = 256, 5


def measured(n_facets: int) -> list[str]:
    data = Epochs.of(turning())
    problem = Problem(registry.find("faceted").bind({"n_facets": n_facets}), data)
    path = tempering_path.TimePath.of(
        data, problem.dim, tempering_path.rotates(problem, data, jax.random.key(0))
    )
    keys = jax.random.split(jax.random.key(0), PARTICLES)
    z = jax.vmap(lambda key: problem.prior_draw(key, data))(keys)
    at = path.at(data, 0.9)
    tuning = moves.Tuning(0.5, 0.5, 1.5, 12, 0.5, jnp.ones(problem.dim))
    halves = [slice(i, None, 2) for i in range(2)]
    states = [moves.start(problem, at, z[half]) for half in halves]

    def move(i: int) -> None:
        out = moves.move(problem, at, data, path.bins, tuning, None, keys[halves[i]], states[i])
        jax.block_until_ready(out)

    def each_us(pool_of: AbstractContextManager[Executor]) -> float:
        took = []
        with pool_of as pool:
            for _ in range(REPEATS + 1):  # the first one compiles
                begun = time.perf_counter()
                list(pool.map(move, range(2)))
                took.append(time.perf_counter() - begun)
        return float(np.median(took[1:])) / PARTICLES * 1e6

    with_own, without = each_us(ThreadPoolExecutor(2)), each_us(threads(2))
    return [
        str(n_facets),
        str(problem.dim),
        f"{with_own:.0f}",
        f"{without:.0f}",
        f"{with_own / without:.1f}",
    ]


def main() -> None:
    rows = [measured(n) for n in (4, 6, 7, 8, 10)]
    heads = [
        "facets",
        "parameters",
        "BLAS with threads (µs a move)",
        "with one (µs a move)",
        "ratio",
    ]
    text = f"{PARTICLES} particles on two threads, {turning().n_obs} epochs; median of {REPEATS}."
    text += "\n\n" + table(heads, rows)
    print(text)
    write_section("Threads of BLAS", "python benchmarks/blas_threads.py", text)


if __name__ == "__main__":
    main()
