"""Speed of the brightness and of the brightness with gradient, in facet-epochs per second.

    python benchmarks/brightness.py            all parts, into RESULTS.md
    python benchmarks/brightness.py --memory   only the peak memory of one large gradient

Each rate is measured inside one jitted loop whose input changes from step to step, so that nothing
is hoisted out of the loop; double precision; best of several repetitions. The gradient is that of a
sum of squares with respect to normals, albedo-areas and both directions. If the machine is busy,
the processor time of the sampler's gradients is more reliable than the wall time.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import time
from collections.abc import Callable

import numpy as np
from _results import table, write_section

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.physics.brightness import flux

LAW = {10: "non-lambertian", 100: "non-lambertian", 500: "lommel-seeliger-lambert"}


def problem(epochs: int, facets: int) -> tuple[np.ndarray, ...]:
    """Random directions, facets and data."""
    rng = np.random.default_rng(0)
    v = [rng.normal(size=(n, 3)) for n in (epochs, epochs, facets)]
    units = [x / np.linalg.norm(x, axis=1, keepdims=True) for x in v]
    return (*units, rng.uniform(0.5, 2.0, facets), rng.uniform(0.0, 1.0, epochs))


def best(
    run: Callable[[], object], repetitions: int, clock: Callable[[], float] = time.perf_counter
) -> float:
    """Shortest of several timings, s, after one run to warm up."""
    run()
    times = []
    for _ in range(repetitions):
        start = clock()
        run()
        times.append(clock() - start)
    return min(times)


def rates(epochs: int, facets: int, repetitions: int = 7) -> tuple[float, float]:
    """Facet-epochs per second of flux, and of its value and gradient."""
    *given, data = (jnp.asarray(x) for x in problem(epochs, facets))
    law = LAW[facets]
    steps = max(1, int(3e7 / (epochs * facets)))

    def misfit(sun, obs, normals, alpha):
        return jnp.sum((flux(sun, obs, normals, alpha, law) - data) ** 2)

    @jax.jit
    def values(sun, obs, normals, alpha):
        def step(_, carry):
            normals, total = carry
            f = flux(sun, obs, normals, alpha, law)
            return normals + 1e-20 * f[0], total + f

        return jax.lax.fori_loop(0, steps, step, (normals, jnp.zeros(epochs)))[1]

    @jax.jit
    def gradients(*args):
        def step(_, carry):
            args, total = carry
            value, slopes = jax.value_and_grad(misfit, (0, 1, 2, 3))(*args)
            moved = tuple(a + 1e-20 * s for a, s in zip(args, slopes, strict=True))
            return moved, total + value

        return jax.lax.fori_loop(0, steps, step, (args, 0.0))

    work = steps * epochs * facets
    value_s = best(lambda: jax.block_until_ready(values(*given)), repetitions)
    gradient_s = best(lambda: jax.block_until_ready(gradients(*given)), repetitions)
    return work / value_s, work / gradient_s


def numpy_rates(epochs: int, facets: int, repetitions: int = 5) -> tuple[float, float]:
    """The same in plain NumPy, with the gradient written by hand."""
    sun, obs, normals, alpha, data = problem(epochs, facets)
    c = 0.1

    def kernel(mu0, mu):
        if LAW[facets] == "non-lambertian":
            w0, w = 1 - (1 - mu0 / 2) ** 5, 1 - (1 - mu / 2) ** 5
            b0, b = w0 * mu0, w * mu / np.pi
            slope0 = (w0 + 2.5 * mu0 * (1 - mu0 / 2) ** 4) * b
            return b0 * b, slope0, b0 * (w + 2.5 * mu * (1 - mu / 2) ** 4) / np.pi
        q = 1 / np.maximum(mu0 + mu, 1e-100)
        lit, seen = mu0 > 0, mu > 0
        return (
            mu0 * mu * (q + c),
            lit * ((mu * q) ** 2 + c * mu),
            seen * ((mu0 * q) ** 2 + c * mu0),
        )

    def cosines():
        return np.maximum(sun @ normals.T, 0), np.maximum(obs @ normals.T, 0)

    def value():
        mu0, mu = cosines()
        if LAW[facets] == "non-lambertian":
            return ((1 - (1 - mu0 / 2) ** 5) * (1 - (1 - mu / 2) ** 5) * mu0 * mu / np.pi) @ alpha
        return (mu0 * mu / np.maximum(mu0 + mu, 1e-100) + c * mu0 * mu) @ alpha

    def gradient():
        k, k0, k1 = kernel(*cosines())
        r = 2 * (k @ alpha - data)[:, None]
        by_normal = alpha[:, None] * (k0.T @ (r * sun) + k1.T @ (r * obs))
        turned = alpha[:, None] * normals
        return by_normal, k.T @ r, r * (k0 @ turned), r * (k1 @ turned)

    work = epochs * facets
    return work / best(value, repetitions), work / best(gradient, repetitions)


def seconds(epochs: int, facets: int) -> tuple[float, float]:
    """Time of one evaluation, and of one value and gradient."""
    value, gradient = rates(epochs, facets, repetitions=3)
    return epochs * facets / value, epochs * facets / gradient


def both_clocks(run: Callable[[], object], count: int) -> list[str]:
    """Wall and processor time, µs, per evaluation, for ``count`` evaluations in one run."""
    clocks = (time.perf_counter, time.process_time)
    return [f"{1e6 * best(run, 7, clock) / count:.3g}" for clock in clocks]


def sampler_gradient(epochs: int, facets: int, law: str, chains: int) -> list[str]:
    """`both_clocks` of the gradient that a sampler needs for each chain, with fixed normals."""
    sun, obs, normals, alpha, data = (jnp.asarray(x) for x in problem(epochs, facets))
    steps = max(1, int(1.5e7 / (epochs * facets * chains)))

    def misfit(sun, obs, alpha):
        return jnp.sum((flux(sun, obs, normals, alpha, law) - data) ** 2)

    def step(_, args):
        slopes = jax.vmap(jax.grad(misfit, (0, 1, 2)))(*args)
        return tuple(a + 1e-20 * s for a, s in zip(args, slopes, strict=True))

    run = jax.jit(lambda *args: jax.lax.fori_loop(0, steps, step, args))
    args = [jnp.stack([x] * chains) for x in (sun, obs, alpha)]
    return both_clocks(lambda: jax.block_until_ready(run(*args)), steps * chains)


def jacobian_by_shape(epochs: int, facets: int, columns: int) -> list[str]:
    """`both_clocks` of the Jacobian with respect to coefficients of the log areas."""
    sun, obs, normals, alpha, _ = (jnp.asarray(x) for x in problem(epochs, facets))
    basis = jnp.asarray(np.random.default_rng(1).normal(size=(facets, columns)))

    def of_logarithms(x):
        return flux(sun, obs, normals, alpha * jnp.exp(basis @ x), "lommel-seeliger-lambert")

    run, x = jax.jit(jax.jacfwd(of_logarithms)), jnp.zeros(columns)
    return both_clocks(lambda: jax.block_until_ready(run(x)), 1)


def sampler_costs() -> list[list[str]]:
    """Rows of the table of evaluations needed in inference."""
    rows = []
    for epochs, facets, law in (
        (1541, 300, "lommel-seeliger-lambert"),
        (300, 6, "non-lambertian"),
    ):
        for chains in (1, 8):
            what = f"gradient, {chains} under vmap" if chains > 1 else "gradient"
            each = sampler_gradient(epochs, facets, law, chains)
            rows.append([f"{epochs} × {facets}", law, what, *each])
    each = jacobian_by_shape(1541, 300, 92)
    return [*rows, ["1541 × 300", "lommel-seeliger-lambert", "Jacobian, 92 columns", *each]]


def one_large_gradient(epochs: int = 1_000_000, facets: int = 100) -> None:
    """Print the process's peak memory in GiB after one value and gradient."""
    *given, data = (jnp.asarray(x) for x in problem(epochs, facets))

    @jax.jit
    def run(*args):
        def misfit(*args):
            return jnp.sum((flux(*args) - data) ** 2)

        return jax.value_and_grad(misfit, (0, 1, 2, 3))(*args)

    jax.block_until_ready(run(*given))
    print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--memory", action="store_true")
    if parser.parse_args().memory:
        one_large_gradient()
        return
    speed = []
    for (epochs, facets), goal in {
        (10_000, 10): (6e8, 2e8),
        (1541, 500): (2e9, 8e8),
    }.items():
        ours, plain = rates(epochs, facets), numpy_rates(epochs, facets)
        for what, mine, theirs, wanted in zip(
            ("flux", "flux and gradient"), ours, plain, goal, strict=True
        ):
            ratio = f"{mine / theirs:.1f}"
            row = [f"{epochs} × {facets}", LAW[facets], what, f"{mine:.2g}", f"{wanted:.0e}"]
            speed.append([*row, f"{theirs:.2g}", ratio])
            print(*speed[-1], sep="\t", flush=True)
    cost = []
    for epochs in (1_000, 10_000, 100_000, 1_000_000):
        value, gradient = seconds(epochs, 10)
        each = [f"{1e9 * s / (10 * epochs):.2f}" for s in (value, gradient)]
        cost.append(
            [f"{epochs:,}", f"{1e3 * value:.3g}", each[0], f"{1e3 * gradient:.3g}", each[1]]
        )
        print(*cost[-1], sep="\t", flush=True)
    sampler = sampler_costs()
    for row in sampler:
        print(*row, sep="\t", flush=True)
    command = [sys.executable, __file__, "--memory"]
    peak = float(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    print(f"peak {peak:.2f} GiB")
    speed_table = table(
        ["epochs × facets", "law", "what", "per s", "goal", "NumPy", "ratio"], speed
    )
    cost_table = table(
        ["epochs (10 facets)", "flux ms", "ns each", "with gradient ms", "ns each"], cost
    )
    sampler_table = table(
        ["epochs × facets", "law", "what", "µs each", "processor µs each"], sampler
    )
    write_section(
        "Speed of brightness",
        "python benchmarks/brightness.py",
        f"Facet-epochs per second, double precision, inside one jitted loop.\n\n{speed_table}\n\n"
        f"Cost of one evaluation against the number of epochs.\n\n{cost_table}\n\n"
        "What inference asks for: gradients by albedo-areas and directions, the Jacobian by "
        f"coefficients of the areas' logarithms.\n\n{sampler_table}\n\n"
        f"Peak memory of a process that takes one gradient of 10⁶ × 100: {peak:.2f} GiB "
        "(goal: under 2).",
    )


if __name__ == "__main__":
    main()
