"""What shadows between parts cost, and how exact they are.

    python benchmarks/shadows.py [--attitudes N]      into RESULTS.md
    python benchmarks/shadows.py --fits               into RESULTS.md

Time: the flux of a body at 300 epochs, and its gradient by the directions, with shadows and
without, each compiled beforehand. Errors: against rays cast at analytic surfaces, at N attitudes.
With --fits, the potential of a fit, its gradient and its Fisher matrix at a draw of the prior, for
case 100 of `bodies.py`: bundled bodies in a flat spin, three passes.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from _body_cases import drawn
from _results import table, write_section

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.modelling import registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem, compiled
from lcbayes.simulation.scenarios.scenario import Scenario, load
from lcbayes.simulation.simulate import body_flux

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from tests.helpers import shaded_bodies as shaded

EPOCHS = 300
TOLERANCE = 1e-3
RAYS = {"mesh": 2_500}  # points on each surface (a quarter of the mesh)
REPEATS = 200


def microseconds(function, *args) -> float:
    """The median of repeated calls, compiled beforehand."""
    jax.block_until_ready(function(*args))
    took = []
    begin = time.perf_counter()
    while len(took) < 5 or (len(took) < REPEATS and time.perf_counter() - begin < 20.0):
        start = time.perf_counter()
        jax.block_until_ready(function(*args))
        took.append(time.perf_counter() - start)
    return 1e6 * float(np.median(took))


def timed(scenario: Scenario) -> list[float]:
    """µs of flux and gradient without shadows, and with them; NaN for what has no gradient."""
    assert scenario.parts is not None
    sun, obs = map(jnp.asarray, shaded.attitudes(EPOCHS, 1))
    result = []
    for parts in (replace(scenario.parts, shaded=False), scenario.parts):

        def flux(sun, obs, parts=parts):
            visible = parts.lit_and_seen(sun, obs)
            return body_flux(scenario.body, scenario.materials, sun, obs, None, visible)

        def total(sun, obs, flux=flux):
            return jnp.sum(flux(sun, obs) ** 2)

        result.append(microseconds(jax.jit(flux), sun, obs))
        smooth = parts.method != "points"
        slope = jax.jit(jax.grad(total, argnums=(0, 1)))
        result.append(microseconds(slope, sun, obs) if smooth else float("nan"))
    return result


def error(name: str, scenario: Scenario, count: int) -> tuple[float, float]:
    """The largest difference from rays, and from no shadows, over the largest flux."""
    sun, obs = shaded.attitudes(count, 2)
    rays = shaded.cast_flux(name, sun, obs, RAYS.get(name, 10_000))
    ours = shaded.flux(scenario, sun, obs)
    whole = shaded.flux(scenario, sun, obs, shaded=False)
    off, shadow = (float(np.max(np.abs(x - ours)) / rays.max()) for x in (rays, whole))
    return off, shadow


def fits() -> None:
    """What a posterior with shadows costs beside one without."""
    rows = []
    for name in ("rocket-stage", "box-wing"):
        curve = drawn(name, "flat", 100, passes=3).curve
        data, entry = Epochs.of(curve), registry.find("body")
        for shadows in (False, True):
            options = entry.check({"body": name, "shadows": shadows})
            problem = Problem(entry.bind(options), data)
            z = problem.prior_draw(jax.random.key(0), data)
            methods = [compiled(x) for x in (problem.potential, problem.slope, problem.fisher)]
            took = [microseconds(method, z, data) / 1e3 for method in methods]
            kind = "with" if shadows else "without"
            rows.append([name, str(len(data.t)), kind, *(f"{x:.2f}" for x in took)])
            print(rows[-1], flush=True)
    columns = ["body", "epochs", "shadows", "potential (ms)", "gradient (ms)", "Fisher matrix (ms)"]
    command = "python benchmarks/shadows.py --fits"
    write_section("Shadows in fits", command, table(columns, rows))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--attitudes", type=int, default=200)
    parser.add_argument("--fits", action="store_true")
    args = parser.parse_args()
    if args.fits:
        fits()
        return
    count = args.attitudes
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        bodies = {name: shaded.scenario(name, Path(folder), TOLERANCE) for name in shaded.TEXTS}
    bodies["box-two-wings (glossy)"] = load("box-two-wings")
    for name, scenario in bodies.items():
        assert scenario.parts is not None
        plain, plain_slope, with_shadows, slope = timed(scenario)
        ratio, slope_ratio = with_shadows / plain, slope / plain_slope
        off = error(name, scenario, count) if name in shaded.TEXTS else None
        rows.append(
            [
                name,
                f"{len(scenario.body.areas)}",
                scenario.parts.method,
                f"{plain:.0f}",
                f"{with_shadows:.0f}",
                f"{ratio:.1f}",
                "–" if np.isnan(slope) else f"{slope:.0f} ({slope_ratio:.1f})",
                *(["–", "–"] if off is None else [f"{off[0]:.1e}", f"{off[1]:.2f}"]),
            ]
        )
        print(rows[-1], flush=True)
    columns = [
        "body",
        "panels",
        "method",
        "without (µs)",
        "with (µs)",
        "ratio",
        "gradient (µs, ratio)",
    ]
    columns += ["error against rays", "largest shadow"]
    text = (
        f"Flux at {EPOCHS} epochs from directions in the body frame, Lambertian but where glossy, "
        f"tolerance {TOLERANCE:g}; errors and shadows over the largest flux, the worst of {count} "
        "attitudes.\n\n"
    )
    command = f"python benchmarks/shadows.py --attitudes {count}"
    write_section("Shadows between parts", command, text + table(columns, rows))


if __name__ == "__main__":
    main()
