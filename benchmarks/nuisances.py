"""Cost of the parameters of small faults, and whether their effect is linear.

    python benchmarks/nuisances.py --write        gradients and linearity, into RESULTS.md
    python benchmarks/nuisances.py --fits 3       the wall time of fits with and without them too

Cases are those of `faults.py` with two or three sites. Times are of the processor, so that other
processes disturb them little. The error of the linear response is the chi2 between the brightness
at the truth with faults drawn from their priors and its first-order approximation.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from _results import table, write_section
from _satellites import Case, Fault, draw_case, write
from numpy.typing import NDArray

import lcbayes
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.data.lightcurve import LightCurve
from lcbayes.modelling import registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem

OFF = {"zero_point_sd": 0.0, "clock_sd": 0.0, "rate_drift_sd": 0.0}
VARIANTS: dict[str, dict[str, float]] = {
    "none": OFF,
    "zero points": {"clock_sd": 0.0, "rate_drift_sd": 0.0},
    "clocks": {"zero_point_sd": 0.0, "rate_drift_sd": 0.0},
    "drift": {"zero_point_sd": 0.0, "clock_sd": 0.0},
    "all three (default)": {},
    "all three and nutation": {"nutation_ratio": 0.4},
}
GRADIENTS, ROUNDS, DRAWS = 10_000, 6, 40  # gradients that outlast the steps of a coarse clock
BODY: dict[str, Any] = {"n_facets": 3, "reflectance": "lambertian"}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=12, help="cases of the linearity")
    parser.add_argument("--gradients", type=int, default=3, help="cases of the gradients")
    parser.add_argument("--fits", type=int, default=0, help="cases fitted with and without")
    parser.add_argument("--write", action="store_true", help="write the tables into RESULTS.md")
    given = parser.parse_args()
    cases = [simulated(seed) for seed in range(max(given.seeds, given.gradients, given.fits))]
    text = gradients([curve for _, curve in cases[: given.gradients]])
    text += "\n\n" + linearity(cases[: given.seeds])
    if given.fits:
        text += "\n\n" + fits([curve for _, curve in cases[: given.fits]])
    print(text)
    if given.write:
        write_section("Small faults: cost and linearity", "python benchmarks/nuisances.py", text)


def simulated(seed: int) -> tuple[Case, LightCurve]:
    """A case without fault at two or three sites."""
    case = draw_case(Fault(clock=1e-12), seed)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "curve.csv"
        write(case, path)
        return case, lcbayes.read(path)


def problem_of(curve: LightCurve, options: dict[str, float]) -> tuple[Problem, Epochs]:
    data = Epochs.of(curve)
    return Problem(registry.find("faceted").bind(BODY | options), data), data


def gradients(curves: list[LightCurve]) -> str:
    """Processor time of a gradient of the potential inside a compiled loop."""
    measured_by_variant = {
        name: [_gradient(*problem_of(c, o)) for c in curves] for name, o in VARIANTS.items()
    }
    rows = []
    for name, values in measured_by_variant.items():
        ratio = np.array([v for v, _ in values]) / np.array(
            [v for v, _ in measured_by_variant["none"]]
        )
        time_us = " ".join(f"{1e6 * v:.1f}" for v, _ in values)
        dims = " ".join(str(d) for _, d in values)
        rows.append([name, dims, time_us, f"{ratio.min():.2f} to {ratio.max():.2f}"])
    heads = ["faults modelled", "parameters", "µs a gradient", "over none"]
    about = f"Cases: {len(curves)}, each of 160 points, three Lambertian facets."
    return f"{table(heads, rows)}\n\n{about}"


def _gradient(problem: Problem, data: Epochs) -> tuple[float, int]:
    def path(z: jax.Array, data: Epochs) -> jax.Array:
        def step(z: jax.Array, _: None) -> tuple[jax.Array, None]:
            return z - 1e-9 * problem.slope(z, data), None

        return jax.lax.scan(step, z, None, length=GRADIENTS)[0]

    run = jax.jit(path)
    z = jnp.asarray(0.5 * np.random.default_rng(0).normal(size=problem.dim))
    run(z, data).block_until_ready()
    return min(_cpu(run, z, data) for _ in range(ROUNDS)) / GRADIENTS, problem.dim


def _cpu(run: Callable[..., jax.Array], *args: Any) -> float:
    begun = time.process_time()
    run(*args).block_until_ready()
    return time.process_time() - begun


def linearity(cases: list[tuple[Case, LightCurve]]) -> str:
    """How far clocks and drift are from linear, over their priors."""
    rows = []
    for seed, (case, curve) in enumerate(cases):
        clock, half, drift = _nonlinear(case, curve)
        period = 2 * np.pi / np.linalg.norm(case.omega)
        drifts = "–" if np.isnan(drift) else f"{drift:.2g}"
        rows.append([str(seed), f"{period:.0f}", f"{clock:.2g}", f"{half:.3f}", drifts])
    heads = ["seed", "period (s)", "clocks", "offsets half as large, over that", "drift"]
    about = "Median chi2 between exact and first-order effects of faults drawn from their priors"
    return f"{about}, at the truth.\n\n{table(heads, rows)}"


def _nonlinear(case: Case, curve: LightCurve) -> tuple[float, float, float]:
    problem, data = problem_of(curve, {"zero_point_sd": 0.0})
    truth = {
        "normals_base": jnp.asarray(case.normals),
        "log_albedo_area": jnp.log(jnp.asarray(case.areas)),
        "omega_unit": jnp.asarray(case.omega / 0.1),
    }
    drifts = "rate_drift_unit" in problem.names

    @jax.jit
    def brightness(clock: jax.Array, drift: jax.Array) -> jax.Array:
        faults = {"clock_offset_unit": clock} | ({"rate_drift_unit": drift} if drifts else {})
        return problem.trace(truth | faults, data)["expected"]["value"]

    still = jnp.zeros(data.n_observers + 1), jnp.zeros(())
    middle, push = jax.linearize(brightness, *still)

    def chi2(clock: Any, drift: Any) -> float:
        fault = jnp.asarray(clock), jnp.asarray(drift)
        return float(jnp.sum(((brightness(*fault) - middle - push(*fault)) / data.error) ** 2))

    rng = np.random.default_rng(0)
    offsets: NDArray[np.float64] = rng.normal(size=(DRAWS, data.n_observers + 1))
    whole = np.array([chi2(c, 0.0) for c in offsets])
    half = np.array([chi2(0.5 * c, 0.0) for c in offsets])
    drift = [chi2(still[0], d) for d in rng.normal(size=DRAWS)] if drifts else [np.nan]
    return float(np.median(whole)), float(np.median(half / whole)), float(np.median(drift))


def fits(curves: list[LightCurve]) -> str:
    """Wall time of complete fits, with and without the default faults, in turn."""
    rows = []
    for seed, curve in enumerate(curves):
        times = []
        for options in (OFF, {}):
            for _ in range(2):  # the second has its programs compiled
                begun = time.monotonic()
                result = lcbayes.fit(curve, seed=seed, **(BODY | options))
                took = time.monotonic() - begun
            times.append(f"{took:.0f} s ({'' if result.trusted else 'not '}trusted)")
        rows.append([str(seed), *times])
    return table(["seed", "fit without", "fit with the default"], rows)


if __name__ == "__main__":
    main()
