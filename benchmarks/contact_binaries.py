"""Asteroids that are not convex, and whether the comparison with a contact binary refuses them.

    python benchmarks/contact_binaries.py -o DIR    every body, 10 seeds each
    python benchmarks/contact_binaries.py -o DIR --cells binary --seeds 1   one case
    python benchmarks/contact_binaries.py -o DIR --table-only --write  the table, into RESULTS.md

Each case is the optimum of `convex-grid` near the true spin, with draws of the Gaussian about it in
place of chains, and `inference.rival` at this solution. It takes one or two minutes in place of
those of a complete fit (`asteroid_faults.py`), and shows what the comparison adds where the search
found the right alias. Six nights of 50 points of 1 % from `_asteroids.py`, which has no code of the
package. Quantities: sidereal period, longitude and latitude of the pole. "Trusted" means that no
contact binary refuses the fit.
"""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple, cast

import numpy as np
from _asteroids import BODIES, Case, draw_case, write
from _cases import Cell, Outcome, command
from _scores import angle_within, within

import lcbayes
from lcbayes.core.jax_setup import jnp
from lcbayes.core.progress import Silent
from lcbayes.inference import solutions
from lcbayes.inference.rival import SPIN, Rival, rival
from lcbayes.inference.start_from import spin_sites
from lcbayes.modelling import registry
from lcbayes.modelling.constrained import constrain_draws
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem, compiled
from lcbayes.results import rivals

SEEDS = 10
CELLS = [Cell(name, 0.0) for name in BODIES]
DRAWS = 400


class Compared(NamedTuple):
    """A case, draws of the spin (`SPIN`) of a convex body, and the contact binary."""

    case: Case
    draws: dict[str, np.ndarray]
    rival: Rival


def compared(kind: str, seed: int, path: Path, **options: Any) -> Compared:
    """Simulate a case and write its file; compare the optimum of a convex body at the true spin."""
    case = draw_case(kind, seed)
    write(case, path)
    curve, entry = lcbayes.read(path), registry.find("convex-grid")
    data, asked = Epochs.of(curve), entry.check({"period": case.given_period_h, **options})
    problem = Problem(entry.bind(asked), data)
    shapes = entry.hook("shapes")
    assert shapes is not None
    lon, lat = true_angles(case)
    pole = {"pole_lon_deg": np.degrees(lon), "pole_lat_deg": np.degrees(lat)}
    spin = spin_sites({"period_h": case.period_h, **pole}, data, case.given_period_h)
    start = np.asarray(problem.ravel({**shapes(data, **asked)[0], **spin}))
    z, potential = solutions.optimum(problem, data, start, np.arange(problem.dim))
    information = np.asarray(compiled(problem.fisher)(jnp.asarray(z), data))
    noise = np.random.default_rng(1).standard_normal((DRAWS, len(z)))
    rows = z + np.linalg.solve(np.linalg.cholesky(information).T, noise.T).T
    sites = constrain_draws(problem, rows[None], data)
    draws = {k: np.asarray(sites[k]).ravel() for k in SPIN}
    log_evidence = solutions.laplace(potential, information)
    posterior = SimpleNamespace(
        data=data,
        modes=[SimpleNamespace(solution=SimpleNamespace(z=z, log_evidence=log_evidence))],
    )
    found = rival(entry, asked, curve, cast("Any", posterior), [draws], Silent())
    assert found is not None
    return Compared(case, draws, found)


def true_angles(case: Case) -> tuple[float, float]:
    """Longitude and latitude of the true pole, rad."""
    x, y, z = case.pole
    return float(np.arctan2(y, x)), float(np.arcsin(z))


def off_deg(case: Case, lon_deg: float, lat_deg: float) -> float:
    """Angle between a pole and the true one, deg."""
    lon, lat = np.radians([lon_deg, lat_deg])
    pole = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
    return float(np.degrees(np.arccos(np.clip(pole @ case.pole, -1.0, 1.0))))


def outcome(cell: Cell, seed: int, out: Path) -> Outcome:
    path = out / "curves" / f"{cell.name}-{seed}.lcs"
    path.parent.mkdir(exist_ok=True)
    case, draws, other = compared(cell.name, seed, path)
    period, lons, lats = draws["period_h"], *(np.radians(draws[k]) for k in SPIN[1:])
    lon, lat = true_angles(case)
    inside = {
        "period": within(period, case.period_h),
        "pole lon": angle_within(lons, lon),
        "pole lat": within(lats, lat),
    }
    middle = np.degrees(np.angle(np.mean(np.exp(1j * lons))))
    about = f"ln odds {other.log_odds:.1f}"
    about += f", convex pole off by {off_deg(case, middle, np.degrees(lats.mean())):.1f} deg"
    if other.spin:
        pole = (other.spin[k][0] for k in SPIN[1:])
        held = min(other.held.values())
        about += f", binary by {off_deg(case, *pole):.1f} deg, intervals hold {held:.2f}"
    codes = [finding.code for finding in rivals.findings(other)]
    return Outcome(not codes, inside, codes, 1, None, 0.0, about)


if __name__ == "__main__":
    command(__doc__, CELLS, SEEDS, outcome, "Asteroids compared with contact binaries")
