"""How ln posterior of an asteroid depends on the normals over which its brightness is summed.

    lcbayes fit CURVE --model convex-grid --period 5.762 -o DIR
    python benchmarks/quadrature.py CURVE 5.762 DIR

For draws of the most probable solution in DIR, ln posterior is computed with several numbers of
normals, at the power of the likelihood that the correlated residuals leave. A constant difference
changes nothing; the standard deviation over draws should be at most 0.5 nat. The lattice is the
equal-area grid that the model had before.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from unittest import mock

import numpy as np
from _results import table, write_section

import lcbayes
from lcbayes.core.jax_setup import jnp
from lcbayes.inference.correlation import tempered
from lcbayes.inference.problem_cache import build_problem
from lcbayes.modelling import registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem, compiled
from lcbayes.models import convex_grid
from lcbayes.physics.bodies import facets

NUMBERS, FINEST, DRAWS = (300, 530, 600, 750, 1200), 12000, 40


def lattice(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Normals of equal weight."""
    return facets.grid(n), np.full(n, 1.0 / n)


def posterior_with(data: Epochs, period: float, n: int) -> Problem:
    """The posterior with n normals."""
    entry = registry.find("convex-grid")
    options = {o.name: o.default for o in entry.options.values()}
    given = entry.check(options | {"period": period, "n_quadrature": n})
    return build_problem(entry, given, data)[0]


def minus_log(data: Epochs, period: float, draws: list[dict], n: int) -> np.ndarray:
    """−ln posterior with n normals at each draw of the sampled sites."""
    problem = posterior_with(data, period, n)
    value = compiled(problem.potential)
    return np.array([float(value(problem.ravel(d), data)) for d in draws])


def main() -> None:
    parser = argparse.ArgumentParser(description="Compare numbers of normals.")
    parser.add_argument("curve", type=Path)
    parser.add_argument("period", type=float)
    parser.add_argument("fit", type=Path)
    given = parser.parse_args()
    data = Epochs.of(lcbayes.read(given.curve))
    fine = posterior_with(data, given.period, FINEST)
    posterior = lcbayes.load(given.fit).data["modes/0/posterior"]
    flat = {k: np.asarray(posterior[k]).reshape(-1, *posterior[k].shape[2:]) for k in fine.names}
    rows = np.linspace(0, len(flat["pole_base"]) - 1, DRAWS).astype(int)
    draws = [{k: jnp.asarray(v[i]) for k, v in flat.items()} for i in rows]
    data = tempered(fine, np.asarray(fine.ravel(draws[0])), data)
    exact = minus_log(data, given.period, draws, FINEST)
    found = []
    for name, rule in (("parallels", facets.rings), ("lattice", lattice)):
        convex_grid.grid.cache_clear()
        with mock.patch.object(facets, "rings", rule):
            for n in NUMBERS:
                normals = len(rule(n)[0])
                left = exact - minus_log(data, given.period, draws, n)
                found.append([name, str(normals), f"{left.mean():+.2f}", f"{left.std():.2f}"])
    convex_grid.grid.cache_clear()
    power = float(np.mean(np.asarray(data.information)))
    text = f"{given.curve.name}, {DRAWS} draws, against {FINEST} normals on parallels, "
    text += f"with a power of {power:.2f}.\n\n"
    heads = ["rule", "normals", "mean difference of ln posterior", "sd over draws"]
    command = f"python benchmarks/quadrature.py {given.curve.name} {given.period:g} DIR"
    write_section("Asteroids: normals of the brightness", command, text + table(heads, found))


if __name__ == "__main__":
    main()
