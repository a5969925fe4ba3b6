"""Bodies that shade themselves, fitted with free facets: is that named, and is it named wrongly?

    python benchmarks/notches.py [--seeds 8] [--snr 40 100] [--bodies "L 0.15 m" bar]

An L-shaped body (a bar of 2 x 1 x 1 m with an arm at one end, points on its faces and rays) and
convex ones are seen from 200 random directions each of Sun and observer with known attitude. Six
diffuse facets are fitted from the faces of the body, and seven from the best fit of six with a
small facet in the best of ten directions. Counted are fits that are refused, and the explanation
that is offered in `lcbayes.results.reasons.why`. "tilted" is a bar with a further face of 0.25 m2,
"lommel" one of Lommel and Seeliger's law in part, and "lobe" one whose faces have a weak wide lobe.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from pathlib import Path

import numpy as np

from lcbayes.core.jax_setup import jnp
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inference.goodness_of_fit import measure
from lcbayes.inference.misfit_tests import examine
from lcbayes.inference.problem_cache import build_problem
from lcbayes.inference.solutions import optimum
from lcbayes.modelling import registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.physics.bodies.facets import grid
from lcbayes.results.reasons import why

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.helpers.l_shaped_body import boxes, flux

POINTS = 200
NORMALS = np.concatenate([np.eye(3), -np.eye(3)])
ARMS = {"L 0.15 m": 0.15, "L 0.3 m": 0.3, "L 0.6 m": 0.6}
CONVEX = ("bar", "tilted", "lommel", "lobe")
SAID = {
    "shades itself": "notch",
    "further facet": "facet",
    "weak lobe": "lobe",
    "times too small": "errors",
}


def brightness(kind: str, sun: np.ndarray, obs: np.ndarray, rng) -> tuple[np.ndarray, float]:
    """Flux (T,) of a body, and the share of its light that shading takes."""
    arm = ARMS.get(kind, 0.0)
    solid = boxes(arm) if arm else boxes(0.0)[:1]
    if arm:
        seen, whole = (flux(solid, sun, obs, s, per_side=16) for s in (True, False))
        return seen, float(1.0 - seen.sum() / whole.sum())
    areas = np.tile([1.0, 2.0, 2.0], 2)
    mu0, mu = (np.clip(v @ NORMALS.T, 0.0, None) for v in (sun, obs))
    result = (mu0 * mu) @ areas / np.pi
    if kind == "tilted":
        normal = rng.standard_normal(3)
        normal /= np.linalg.norm(normal)
        result += 0.25 / np.pi * np.clip(sun @ normal, 0, None) * np.clip(obs @ normal, 0, None)
    elif kind == "lommel":
        result = 0.6 * result + 0.5 / np.pi * (mu0 * mu / np.maximum(mu0 + mu, 1e-9)) @ areas
    elif kind == "lobe":
        bisector = (sun + obs) / np.linalg.norm(sun + obs, axis=1, keepdims=True)
        along = np.clip(bisector @ NORMALS.T, 0.0, None)
        result += 0.15 / np.pi * np.where((mu0 > 0) & (mu > 0), along**15, 0.0) @ areas
    return result, 0.0


def fitted(curve: LightCurve, normals: np.ndarray, areas: np.ndarray):
    """The problem of as many facets and its optimum from these."""
    data, entry = Epochs.of(curve), registry.find("faceted")
    options = {"n_facets": len(normals), "spin": "none", "reflectance": "lambertian"}
    problem = build_problem(entry, entry.check(options), data)[0]
    sites = {"normals_base": normals, "log_albedo_area": np.log(areas), "log_level": np.zeros(0)}
    start = problem.ravel({k: jnp.asarray(sites[k], float) for k in problem.names})
    z, potential = optimum(problem, data, np.asarray(start), np.arange(problem.dim))
    return problem, data, z, potential


def said(curve: LightCurve, result) -> tuple[str, float]:
    """What is offered as the cause of a misfit, "" without one; χ² per degree of freedom."""
    problem, data, z, _ = result
    missed = measure(problem, data, z[None], examine(problem, z, data, curve))
    assert missed.chi2 is not None
    ratio = missed.chi2 / missed.dof
    if missed.explained:
        return "", ratio
    words = why(missed)
    return next((name for text, name in SAID.items() if text in words), "none"), ratio


def case(kind: str, snr: float, seed: int) -> tuple[float, list[tuple[str, float]]]:
    """The loss to shading, and what is said with six and with seven facets."""
    rng = np.random.default_rng([seed, 5])
    sun, obs = rng.standard_normal((2, POINTS, 3))
    sun, obs = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in (sun, sun + obs))
    clean, loss = brightness(kind, sun, obs, rng)
    error = np.full(POINTS, clean.mean() / snr)
    curve = LightCurve(
        t=np.arange(float(POINTS)),
        brightness=clean + error * rng.standard_normal(POINTS),
        error=error,
        sun=sun,
        obs=obs,
        kind="flux",
        free_scale=np.array([False]),
    )
    arm = ARMS.get(kind, 0.0)
    six = fitted(curve, NORMALS, np.tile([1.0 + arm, 2.0 + arm, 2.0], 2))
    sites = six[0].constrain(jnp.asarray(six[2]), six[1])
    normals, areas = np.asarray(sites["normals"]), np.asarray(sites["albedo_area"])
    every = [fitted(curve, np.vstack([normals, n]), np.append(areas, 0.1)) for n in grid(10)]
    seven = min(every, key=lambda one: one[3])
    return loss, [said(curve, six), said(curve, seven)]


def main() -> None:
    parser = argparse.ArgumentParser(description="Count explanations of misfits by shading.")
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--snr", type=float, nargs="+", default=[40.0, 100.0])
    parser.add_argument("--bodies", nargs="+", default=[*ARMS, *CONVEX])
    args = parser.parse_args()
    print("| body | SNR | light lost | facets | χ²/dof | refused | notch | facet | lobe |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- | --- |")
    for kind in args.bodies:
        for snr in args.snr:
            result = [case(kind, snr, seed) for seed in range(args.seeds)]
            loss = np.mean([one[0] for one in result])
            for k, n in enumerate((6, 7)):
                words = Counter(one[1][k][0] for one in result)
                ratio = np.median([one[1][k][1] for one in result])
                refused = args.seeds - words[""]
                counts = " | ".join(str(words[name]) for name in ("notch", "facet", "lobe"))
                print(
                    f"| {kind} | {snr:.0f} | {loss:.3f} | {n} | {ratio:.2f} | "
                    f"{refused} of {args.seeds} | {counts} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
