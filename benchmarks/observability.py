"""Maps of information, and comparison of posteriors with their predicted bounds.

    python benchmarks/observability.py map        10⁶ geometries of three bodies
    python benchmarks/observability.py bound      posterior sd over bound, SNR 10 to 1000

The bound is that of `lcbayes observability` at the truth, without a prior. The posterior is that of
the model of `lcbayes fit`, priors included, given noisy data. It is sampled by many chains of the
exact Fisher-adaptive kernel, which start at draws from the Gaussian of the bound, because the bound
applies to the mode at the truth. Standard errors are those between chains.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from _results import table, write_section

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.modelling import registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.physics.bodies.facets import grid
from lcbayes.samplers.kernels import AHMC
from lcbayes.simulation.observability.campaign import campaign
from lcbayes.simulation.observability.measurements import measure, over_directions
from lcbayes.simulation.observability.parameters import Unknowns
from lcbayes.simulation.scenarios import scenario
from lcbayes.simulation.scenarios.scenario import ConstantRate, Noise
from lcbayes.simulation.simulate import simulate

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.helpers import many_chains

SNR = (10.0, 30.0, 100.0, 300.0, 1000.0)
SEEDS = (1, 2)
CHAINS, BURN, DRAWS = 200, 40, 120
CASES = {"one facet, two passes": ("one-facet", 1), "two facets and ω": ("two-facet-spin", 2)}


def maps() -> None:
    suns, observers = grid(100), grid(10_000)
    sun, obs = np.repeat(suns, len(observers), axis=0), np.tile(observers, (len(suns), 1))
    rows = []
    for name in ("one-facet", "box-wing", "brick"):
        what = scenario.load(name)
        over_directions(what, sun[:10], obs[:10])
        begun = time.monotonic()
        flux, gradient = over_directions(what, sun, obs)
        seconds = time.monotonic() - begun
        lit = np.mean(np.sum(gradient**2, axis=1) > 0.0)
        rows.append(
            [name, f"{len(what.body.areas)}", f"{len(flux):,}", f"{lit:.2f}", f"{seconds:.2f}"]
        )
    text = (
        "Flux and its gradient by the attitude for every pair of 100 directions of the Sun and "
        "10,000 of the observer, in the body frame; compilation included.\n\n"
        + table(["scenario", "facets", "geometries", "share that tells anything", "seconds"], rows)
    )
    write_section("Map of information", "python benchmarks/observability.py map", text)


class Case:
    """A scenario at one noise level: the bound, and the posterior of noisy data."""

    def __init__(self, name: str, n_facets: int, snr: float) -> None:
        self.what = replace(scenario.load(name), noise=Noise("snr", snr))
        result = campaign(Unknowns.of(self.what), measure(self.what))
        self.names, self.fisher = result.unknowns.names, result.fisher
        self.bound = result.bound
        spin = "free" if "omega_x" in self.names else "none"
        self.model = registry.find("faceted").bind({"n_facets": n_facets, "spin": spin})

    def ratios(self, seed: int) -> tuple[np.ndarray, np.ndarray, float]:
        """Posterior sd over the bound, its standard error, and the effective draws."""
        curve, truth = simulate(self.what, seed)
        data = Epochs.of(curve)
        problem = Problem(self.model, data)
        normals = np.array([f["normal"] for f in truth["facets"]])
        u = np.array([f["u"] for f in truth["facets"]])
        v = np.cross(normals, u)
        omega = np.zeros(3)
        if isinstance(self.what.attitude, ConstantRate):
            omega = np.asarray(self.what.attitude.omega_rad_s)
        area = np.array([f["albedo_area_m2"] for f in truth["facets"]])

        def sites(theta):  # (D,) deviations from the truth, in the order of the bound
            value = dict(zip(self.names, theta, strict=True))
            tilt = [[value[f"normal_{i}_{k}"] for k in "uv"] for i in range(len(area))]
            tilt = np.asarray(tilt)
            made = {
                "normals_base": jnp.asarray(normals + tilt[:, :1] * u + tilt[:, 1:] * v),
                "log_albedo_area": jnp.asarray(
                    np.log(area) + [value[f"log_albedo_area_{i}"] for i in range(len(area))]
                ),
            }
            if "omega_x" in value:
                moved = omega + [value[f"omega_{a}"] for a in "xyz"]
                made["omega_unit"] = jnp.asarray(moved / 0.1)
            return made

        def quantities(z):
            s = problem.constrain(z, data)
            n = s["normals"]
            result = {}
            for i in range(len(area)):
                result[f"normal_{i}_u"] = n[i] @ u[i] / (n[i] @ normals[i])
                result[f"normal_{i}_v"] = n[i] @ v[i] / (n[i] @ normals[i])
                result[f"log_albedo_area_{i}"] = jnp.log(s["albedo_area"][i] / area[i])
            for k, axis in enumerate("xyz"):
                if "omega" in s:
                    result[f"omega_{axis}"] = s["omega"][k] - omega[k]
            return jnp.stack([result[name] for name in self.names])

        # Noise shifts the posterior's peak from the truth; two Newton steps reach it.
        centre = problem.ravel(sites(np.zeros(len(self.names))))
        slope = jax.jit(jax.grad(problem.potential))
        for _ in range(4):
            step = np.linalg.solve(problem.fisher(centre, data), slope(centre, data))
            centre = centre - step
        rng = np.random.default_rng(seed)
        spread = np.linalg.inv(np.asarray(problem.fisher(centre, data)))
        start = np.asarray(centre) + rng.multivariate_normal(
            np.zeros(problem.dim), 0.5 * (spread + spread.T), CHAINS
        )
        kernel = AHMC(
            potential_fn=partial(problem.potential, data=data),
            fisher_fn=partial(problem.fisher, data=data),
            exact=True,
            step_size=0.6,
            num_steps=4,
            covariance=0.5 * (spread + spread.T),
            proposal_scale=1.0,
        )
        middle = np.asarray(quantities(centre))
        result = many_chains.run(
            kernel, start, quantities, (middle, self.bound), draws=DRAWS, burn=BURN, seed=seed
        )
        mean = result.first.mean(axis=0)
        variance = result.second.mean(axis=0) - mean**2
        per_chain = result.second - 2.0 * mean * result.first + mean**2
        error = per_chain.std(axis=0, ddof=1) / np.sqrt(CHAINS)
        ratio = np.sqrt(variance) / self.bound
        return ratio, 0.5 * ratio * error / variance, result.accept_prob


def bound_row(label: str, snr: float) -> list[str]:
    """A row of the table: one case at one noise level."""
    case = Case(*CASES[label], snr)
    result = [case.ratios(seed) for seed in SEEDS]
    ratio, error = (np.array([f[k] for f in result]) for k in (0, 1))
    mean = ratio.mean(axis=0)
    return [
        label,
        f"{snr:g}",
        f"{mean.min():.3f} … {mean.max():.3f}",
        case.names[int(np.argmax(np.abs(mean - 1.0)))],
        f"{ratio.min():.3f} … {ratio.max():.3f}",
        f"{error.max():.3f}",
        f"{min(f[2] for f in result):.2f}",
    ]


def write_bound(rows: list[list[str]]) -> None:
    heads = [
        "problem",
        "SNR",
        "mean over seeds, least … largest parameter",
        "worst parameter",
        "single seeds",
        "largest standard error",
        "acceptance",
    ]
    text = (
        f"Posterior sd over the Cramér-Rao bound of each parameter, {len(SEEDS)} noise seeds, "
        f"{CHAINS} chains of {DRAWS} draws by the exact Fisher-adaptive kernel. SNR: mean flux "
        "over noise. Aim: within 3 % of one as the noise falls.\n\n" + table(heads, rows)
    )
    write_section("The bound is met", "python benchmarks/observability.py bound", text)


def bound() -> None:
    rows = []
    for label in CASES:
        for snr in SNR:
            rows.append(bound_row(label, snr))
            print(rows[-1], flush=True)
    write_bound(rows)


if __name__ == "__main__":
    if sys.argv[1:] not in (["map"], ["bound"]):
        sys.exit(__doc__)
    maps() if sys.argv[1] == "map" else bound()
