"""Bodies of known shape from their light curves, and Minkowski's problem alone.

    taskset -c 0 python benchmarks/shape.py            into RESULTS.md

Lambertian bodies of known attitude, with Sun and observer in random directions at each epoch, and
noise of 1 % of the mean flux. The shape is that of the few facets that explain the light curve.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from _results import table, write_section
from scipy.spatial import ConvexHull

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.albedo_area import nnls
from lcbayes.inversion.albedo_area.distribution import grid, solve
from lcbayes.inversion.albedo_area.inversion import InversionSettings, invert
from lcbayes.inversion.albedo_area.kernel import columns
from lcbayes.inversion.albedo_area.observed import Observed
from lcbayes.physics.attitude.laws import Fixed
from lcbayes.physics.bodies import facets, shapes
from lcbayes.physics.bodies.closure import close
from lcbayes.physics.bodies.minkowski import minkowski
from lcbayes.physics.bodies.polyhedron import Polyhedron

NOISE = 0.01
TIMED, BATCH = 3, 4


def directions(rng: np.random.Generator, n: int) -> np.ndarray:
    v = rng.normal(size=(n, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def curve(normals: np.ndarray, areas: np.ndarray, epochs: int, seed: int) -> LightCurve:
    rng = np.random.default_rng(seed)
    sun, obs = directions(rng, epochs), directions(rng, epochs)
    flux = np.maximum(sun @ normals.T, 0) * np.maximum(obs @ normals.T, 0) @ areas / np.pi
    error = np.full(epochs, NOISE * flux.mean())
    return LightCurve(
        t=np.arange(float(epochs)),
        brightness=flux + error * rng.normal(size=epochs),
        error=error,
        sun=sun,
        obs=obs,
    )


def many_faced(seed: int, n: int = 38) -> tuple[np.ndarray, np.ndarray, float]:
    """Normals, areas and volume of a body bounded by random tangent planes of an ellipsoid."""
    rng = np.random.default_rng(100 + seed)
    while True:
        normals = directions(rng, n)
        h = np.linalg.norm(normals * [1.4, 1.0, 0.8], axis=1)
        dual = ConvexHull(normals / h[:, None])
        if len(dual.vertices) < n or np.any(dual.equations[:, 3] > -0.1):
            continue
        corners = np.array([np.linalg.solve(normals[s], h[s]) for s in dual.simplices])
        areas = np.array(
            [_area(normals[i], corners[np.any(dual.simplices == i, 1)]) for i in range(n)]
        )
        if areas.min() > 0.01 * areas.mean():
            return normals, areas, float(ConvexHull(corners).volume)


def _area(normal: np.ndarray, points: np.ndarray) -> float:
    return float(ConvexHull(points @ np.linalg.svd(normal[None])[2][1:].T).volume)


def bodies(
    title: str, make: Callable[[int], tuple[np.ndarray, np.ndarray, float]], epochs: int, seeds: int
) -> list[str]:
    """A row: errors of volume and of the face areas, over noise seeds."""
    volume, face, count, took = [], [], [], []
    for seed in range(seeds):
        normals, areas, truth = make(seed)
        begun = time.perf_counter()
        result = invert(
            curve(normals, areas, epochs, seed),
            Fixed(),
            settings=InversionSettings(n_bootstrap=0, n_null=0),
        )
        took.append(time.perf_counter() - begun)
        assert result.shape is not None
        assert result.facets is not None
        volume.append(result.shape.volume / truth - 1.0)
        count.append(len(result.facets.areas))
        if len(normals) == 6:
            near = np.argmax(result.facets.normals @ normals.T, axis=1)
            face.append(np.bincount(near, result.facets.areas, 6) / areas - 1.0)
        print(f"{title}, seed {seed}: volume {volume[-1]:+.4f}, {count[-1]} facets", flush=True)
    return [
        title,
        str(epochs),
        str(seeds),
        f"{100 * np.max(np.abs(volume)):.2f} %",
        f"{100 * np.max(np.abs(face)):.2f} %" if face else "–",
        f"{min(count)} to {max(count)}",
        f"{np.median(took):.1f}",
    ]


def polygon_areas(body: Polyhedron, n: int) -> np.ndarray:
    """Areas of the faces, computed from their vertices alone."""
    out = np.zeros(n)
    for face, facet in zip(body.faces, body.facet, strict=True):
        p = body.vertices[face]
        out[facet] = 0.5 * np.linalg.norm(np.cross(p, np.roll(p, -1, axis=0)).sum(axis=0))
    return out


def reconstruction() -> list[list[str]]:
    rng = np.random.default_rng(0)
    normals = facets.grid(512)
    ellipsoid = np.linalg.norm(normals * [3.0, 1.0, 0.6], axis=1) ** -4.0
    cylinder = shapes.cylinder(1.0, 3.0, 510)
    cases = {
        "equal areas": (normals, np.ones(512)),
        "ellipsoid 3 : 1 : 0.6": (normals, ellipsoid),
        "areas log-normal, sd 1": (normals, np.exp(rng.normal(size=512))),
        "areas log-normal, sd 2": (normals, np.exp(2.0 * rng.normal(size=512))),
        "prism of 510 sides": (cylinder.normals, cylinder.areas),
    }
    rows = []
    for title, (n, raw) in cases.items():
        areas = close(n, raw)
        assert np.all(areas > 0)
        took = []
        for _ in range(TIMED):
            begun = time.perf_counter()
            body = minkowski(n, areas)
            took.append(time.perf_counter() - begun)
        error = np.max(np.abs(polygon_areas(body, 512) / areas - 1.0))
        rows.append([title, f"{min(took):.2f}", f"{error:.1e}"])
        print(rows[-1], flush=True)
    return rows


def solvers() -> list[list[str]]:
    rows = []
    brick = shapes.box(2.0, 1.4, 0.8)
    for epochs, n in ((300, 162), (300, 400), (1541, 300)):
        seen = Observed.of(curve(brick.normals, brick.areas, epochs, 0), Fixed())
        normals, which = grid(n)
        matrix = columns(seen, normals, which)
        # a smooth body has most normals active: the hard case for active sets
        for body, truth in (("brick", None), ("sphere", matrix.sum(axis=1))):
            data = seen
            if truth is not None:
                noise = NOISE * truth.mean() * np.random.default_rng(0).normal(size=epochs)
                data = seen.with_flux(truth + noise)
                data = data.with_error(np.full(epochs, NOISE * truth.mean()))
            rows_, target = matrix / data.error[:, None], data.flux / data.error
            gram = jnp.asarray(np.tile(rows_.T @ rows_, (BATCH, 1, 1)))
            moment = jnp.asarray(np.tile(rows_.T @ target, (BATCH, 1)))
            one, many = [], []
            for _ in range(TIMED + 1):
                begun = time.perf_counter()
                exact = solve(data, normals, which, matrix)
                one.append(time.perf_counter() - begun)
                begun = time.perf_counter()
                result = np.asarray(jax.block_until_ready(nnls.batched(gram, moment)))[0]
                many.append((time.perf_counter() - begun) / BATCH)
            chi2 = np.sum((rows_ @ result - target) ** 2)
            rows.append(
                [
                    f"{epochs} × {n}",
                    body,
                    f"{1e3 * min(one[1:]):.1f}",
                    f"{1e3 * min(many[1:]):.1f}",
                    f"{(chi2 - exact.chi2) / exact.chi2:.0e}",
                ]
            )
            print(rows[-1], flush=True)
    return rows


def main() -> None:
    brick = shapes.box(2.0, 1.4, 0.8)
    known = [
        bodies("brick 2 × 1.4 × 0.8", lambda _: (brick.normals, brick.areas, 2.24), 300, 10),
        bodies("38 faces", many_faced, 1000, 3),
    ]
    heads = ["body", "epochs", "seeds", "worst volume", "worst face area", "facets", "s each"]
    text = (
        "Goal: volumes, and each face area of the brick, within 5 %.\n\n"
        + table(heads, known)
        + "\n\nMinkowski's problem for 512 facets; areas measured from the vertices of the result. "
        "Goal: within 1 s, relative error of an area at most 1e-3. Times are the best of three.\n\n"
        + table(["areas", "s", "largest relative error of an area"], reconstruction())
        + "\n\nNon-negative least squares on the grid: the active-set method, and the "
        "interior-point method under XLA from the normal equations, several at once.\n\n"
        + table(
            ["epochs × normals", "body", "exact, ms", "batched, ms each", "χ² above, relative"],
            solvers(),
        )
    )
    write_section("Shape from known attitude", "taskset -c 0 python benchmarks/shape.py", text)


if __name__ == "__main__":
    main()
