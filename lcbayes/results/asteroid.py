"""Bodies and spins of the draws of an asteroid's posterior, and what follows from them."""

# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownArgumentType=false, reportUnknownVariableType=false
# (pandas, xarray, ArviZ and JAX come without complete types)

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from lcbayes.core.constants import DAY_S
from lcbayes.core.errors import InputError
from lcbayes.geometry.spherical import unit_vector, unwrapped
from lcbayes.physics.attitude.spin_state import SpinState, angle_about_deg, meridians
from lcbayes.physics.bodies.closure import close
from lcbayes.physics.bodies.minkowski import minkowski
from lcbayes.physics.bodies.polyhedron import Polyhedron
from lcbayes.results.content import BodyContent, BodyRow

Floats = NDArray[np.float64]

NEEDED = ("albedo_area", "coefficients", "pole_lon_deg", "pole_lat_deg", "period_h", "lambert_c")
ECLIPTIC = "ecliptic-j2000"
BODIES = 100  # draws of a solution for which the body is constructed
FEWEST = 20  # bodies below which no quantiles are given
LARGE_TILT_DEG = 10.0  # of the axis of largest inertia from the spin axis
FARTHEST_TURN_DEG = 60.0  # of the shape of a draw about the pole from the mean shape

QUANTITIES = {
    "extent_a": "extent along the axis of least inertia ÷ volume-equivalent diameter",
    "extent_b": "extent along the axis of middle inertia ÷ volume-equivalent diameter",
    "extent_c": "extent along the axis of largest inertia ÷ volume-equivalent diameter",
    "extent_ab": "ratio of the extents a/b",
    "extent_bc": "ratio of the extents b/c",
    "ellipsoid_ab": "axis ratio a/b of the dynamically equivalent ellipsoid",
    "ellipsoid_bc": "axis ratio b/c of the dynamically equivalent ellipsoid",
    "volume": "volume ÷ volume of the sphere with the same albedo-area",
    "inertia_tilt_deg": "angle between the axis of largest inertia and the spin axis (deg)",
    "inertia_deficit": "1 − (moment of inertia about the spin axis ÷ largest moment)",
}


@dataclass(frozen=True)
class DrawnBody:
    """The body of one draw.

    Attributes
    ----------
    body : Polyhedron
        In units of its volume-equivalent diameter; z is the spin axis.
    volume_ratio : float
        Volume over that of the sphere with the same area.
    spin : SpinState
    """

    body: Polyhedron
    volume_ratio: float
    spin: SpinState


@dataclass(frozen=True)
class Asteroid:
    """The draws of one solution of a fit of the model "convex-grid".

    Attributes
    ----------
    draws : xarray.Dataset
        With chains and draws.
    normals : (N, 3)
        The grid, body frame.
    middle_jd : float
        Middle of the data, at which the body axes are `rotations.brought_to` of the pole.
    weight : float
        Of the solution.
    frame : str
    """

    draws: xr.Dataset
    normals: Floats
    middle_jd: float
    weight: float
    frame: str

    def flat(self, name: str) -> Floats:
        """A variable with its chains concatenated, (S, …)."""
        values = self.draws[name].transpose("chain", "draw", ...).to_numpy()
        return values.reshape(-1, *values.shape[2:])

    @property
    def poles(self) -> Floats:
        """Unit vectors, (S, 3)."""
        return unit_vector(
            np.radians(self.flat("pole_lon_deg")), np.radians(self.flat("pole_lat_deg"))
        )

    @property
    def mean_spin(self) -> SpinState:
        """The spin of the mean pole and the mean period: that of ``spin.txt``."""
        mean = self.poles.mean(axis=0)
        period = float(self.flat("period_h").mean())
        return SpinState.of_pole(mean / np.linalg.norm(mean), period, self.middle_jd)

    def bodies(self, most: int = BODIES) -> tuple[list[DrawnBody], int]:
        """The bodies of at most ``most`` draws, evenly spaced, and the number that failed."""
        poles, periods, areas = self.poles, self.flat("period_h"), self.flat("albedo_area")
        pick = np.linspace(0, len(poles) - 1, min(most, len(poles))).round().astype(int)
        bodies, failed = [], 0
        for k in np.unique(pick):
            try:
                body = minkowski(self.normals, close(self.normals, areas[k]))
            except InputError:
                failed += 1
                continue
            spin = SpinState.of_pole(poles[k], float(periods[k]), self.middle_jd)
            sphere = (body.areas.sum() / np.pi) ** 1.5 * np.pi / 6.0
            bodies.append(DrawnBody(body.of_unit_diameter, body.volume / sphere, spin))
        return bodies, failed

    def rotation_angle_deg(self, jd: ArrayLike) -> Floats:
        """The rotation angle φ of the mean shape at Julian dates (T,), for each draw, (S, T).

        Draws differ in the angle by which the body has rotated and in the orientation of the
        features of its shape in the body frame. The second is the rotation about the pole that
        brings the log albedo-areas closest to those of the mean shape (`turns_about_pole`). φ is
        the angle about the mean pole, that of ``spin.txt``, to which the meridian of the body
        points. It is therefore not affected by errors of the longitude of the pole, its origin.
        """
        jd = np.atleast_1d(np.asarray(jd, float))
        poles, mean = self.poles, self.poles.mean(axis=0)
        cycles = (jd - self.middle_jd) * 24.0 / self.flat("period_h")[:, None]
        turn = np.radians(turns_about_pole(self.flat("coefficients")))[:, None]
        angle = (turn + 2.0 * np.pi * np.mod(cycles, 1.0))[..., None]
        first, second = (axis[:, None] for axis in meridians(poles))
        toward = np.cos(angle) * first + np.sin(angle) * second
        phi = angle_about_deg(mean / np.linalg.norm(mean), toward)
        return unwrapped(phi, 360.0, axis=0)


def asteroids(tree: xr.DataTree) -> list[Asteroid]:
    """The solutions of a fit, heaviest first; empty unless it is of an asteroid.

    The model must have a body on a fixed grid of normals that rotates about a fixed pole, and the
    light curve absolute times.
    """
    posterior, constant = tree["posterior"].to_dataset(), tree["constant_data"].to_dataset()
    epoch = tree.attrs.get("epoch_jd")
    known = set(map(str, posterior.data_vars))
    if epoch is None or "grid_normals" not in constant or not known.issuperset(NEEDED):
        return []
    t = constant["t"].to_numpy()
    middle = float(epoch) + (t.min() + 0.5 * np.ptp(t)) / DAY_S
    frame, normals = str(tree.attrs.get("frame")), constant["grid_normals"].to_numpy()
    if "modes" not in tree:
        return [Asteroid(posterior.load(), normals, middle, 1.0, frame)]
    labels = posterior.coords.get("solution", xr.zeros_like(posterior["chain"], dtype=int))
    shares = posterior.coords.get("weight", xr.ones_like(posterior["chain"], dtype=float))
    asteroids_ = []
    for name in sorted(tree["modes"].children, key=int):
        weight = float(np.asarray(shares)[np.asarray(labels) == int(name)].sum())
        draws = tree[f"modes/{name}/posterior"].to_dataset().load()
        asteroids_.append(Asteroid(draws, normals, middle, weight, frame))
    total = sum(a.weight for a in asteroids_)
    return [Asteroid(a.draws, normals, middle, a.weight / total, frame) for a in asteroids_]


def turns_about_pole(coefficients: Floats) -> Floats:
    """The angle by which each body is turned about z with respect to the mean body, (S,) deg.

    The least squares of the differences of the coefficients, each over its variance among the
    draws: coefficients of high degree, which light curves do not determine, have little weight.

    Parameters
    ----------
    coefficients : (S, (L+1)² − 1)
        Real harmonics of the log areas, degree by degree from 1, orders −l to l. The order ±m
        of a body turned by δ is c cos mδ − s sin mδ and s cos mδ + c sin mδ.
    """
    degree = round(np.sqrt(coefficients.shape[1] + 1)) - 1
    mean, variance = coefficients.mean(axis=0), coefficients.var(axis=0)
    variance = variance + max(1e-3 * float(variance.max()), 1e-12)
    angle = np.radians(np.linspace(-FARTHEST_TURN_DEG, FARTHEST_TURN_DEG, 481))
    overlap = np.zeros((len(coefficients), len(angle)))
    for n in range(1, degree + 1):
        for m in range(1, n + 1):
            cos, sin = n * n - 1 + n + m, n * n - 1 + n - m
            same = coefficients[:, cos] * mean[cos] + coefficients[:, sin] * mean[sin]
            crossed = coefficients[:, sin] * mean[cos] - coefficients[:, cos] * mean[sin]
            pair = np.outer(same, np.cos(m * angle)) + np.outer(crossed, np.sin(m * angle))
            overlap += pair / (variance[cos] + variance[sin])
    best = np.clip(np.argmax(overlap, axis=1), 1, len(angle) - 2)
    row = np.arange(len(best))
    low, top, high = (overlap[row, best + k] for k in (-1, 0, 1))
    curvature = np.minimum(low - 2.0 * top + high, -1e-300)
    step = np.clip(0.5 * (low - high) / curvature, -1.0, 1.0)
    return np.degrees(angle[best] + step * (angle[1] - angle[0]))


def measured(bodies: Sequence[DrawnBody]) -> dict[str, Floats]:
    """The `QUANTITIES` of each body, (S,)."""
    rows = [_measured(b) for b in bodies]
    return {name: np.array([row[name] for row in rows]) for name in QUANTITIES}


def _measured(drawn: DrawnBody) -> dict[str, float]:
    body = drawn.body
    moments, axes = body.principal
    a, b, c = body.dimensions
    p, q, r = body.ellipsoid
    spinning = float(body.inertia[2, 2])
    return {
        "extent_a": float(a),
        "extent_b": float(b),
        "extent_c": float(c),
        "extent_ab": float(a / b),
        "extent_bc": float(b / c),
        "ellipsoid_ab": float(p / q),
        "ellipsoid_bc": float(q / r),
        "volume": drawn.volume_ratio,
        "inertia_tilt_deg": float(np.degrees(np.arccos(min(1.0, abs(axes[2, 2]))))),
        "inertia_deficit": float(1.0 - spinning / moments[2]),
    }


def body_content(asteroid: Asteroid, most: int = BODIES) -> BodyContent:
    """The posterior of the `QUANTITIES` of a solution, for ``summary.json``.

    ``tilted`` is whether 95 % of the bodies have their axis of largest inertia more than 10° from
    the spin axis. Without enough bodies ``quantities`` is empty.
    """
    bodies, failed = asteroid.bodies(most)
    rows: dict[str, BodyRow] = {}
    if len(bodies) >= min(FEWEST, asteroid.draws.sizes["draw"]):
        rows = {name: row(values) for name, values in measured(bodies).items()}
    tilted = bool(rows) and rows["inertia_tilt_deg"]["q05"] > LARGE_TILT_DEG
    return {
        "n_bodies": len(bodies),
        "n_failed": failed,
        "quantities": rows,
        "tilted": bool(tilted),
    }


def row(values: Floats) -> BodyRow:
    """Mean, sd and quantiles of draws (S,)."""
    low, middle, high = np.quantile(values, (0.05, 0.5, 0.95))
    sd = float(np.std(values, ddof=1)) if len(values) > 1 else float("nan")
    return {
        "mean": float(values.mean()),
        "sd": sd,
        "q05": float(low),
        "q50": float(middle),
        "q95": float(high),
    }


def tilt_warning(content: BodyContent | None) -> str:
    """A sentence if the spin axis is far from the axis of largest inertia, else empty."""
    if content is None or not content["tilted"]:
        return ""
    tilt = content["quantities"]["inertia_tilt_deg"]
    deficit = content["quantities"]["inertia_deficit"]
    return (
        f"the axis of largest inertia is {tilt['q50']:.0f}° from the spin axis "
        f"({tilt['q05']:.0f}° to {tilt['q95']:.0f}°), and the moment about the spin axis is "
        f"{100 * deficit['q50']:.0f} % below the largest: for uniform density, an asteroid that "
        "spins steadily would have them aligned"
    )
