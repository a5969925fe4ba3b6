"""An ellipsoid that occults a star: chords in closed form, and a posterior about the truth."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import xarray as xr

from lcbayes.data.formats.occultation import LIGHT_KM_S, Occultation
from lcbayes.geometry.sky_plane import west_north
from lcbayes.physics.attitude.spin_state import SpinState
from lcbayes.physics.bodies import facets
from tests.helpers.asteroids import unit
from tests.helpers.damit_model import Model

TO_EARTH = np.array([-1.56e8, -1.58e8, -1.4e7])
MIDDLE_JD = 2450000.0  # of the light curve of the posterior
PERIOD_H, POLE, MIRROR = 8.4006, (272.0, 52.0), (92.0, 55.0)
AXES = np.array([44.0, 40.0, 33.0])  # semi-axes, km
CENTRE = np.array([-4200.0, 2430.0])
SPEED = 5.5  # km/s
START_JD = 2454811.82


SPIN = SpinState.of_pole(unit(*POLE), PERIOD_H, MIDDLE_JD)


def ellipse(axes: np.ndarray, jd: float) -> np.ndarray:
    """Q (2, 2) with h(n)² = n·Q n for the outline of the ellipsoid: closed form."""
    turn = Model(np.zeros((1, 3, 3)), *POLE, PERIOD_H, SPIN.epoch_jd, SPIN.phase0_deg)
    plane = west_north(TO_EARTH) @ turn.to_ecliptic(jd)
    return plane @ np.diag(axes**2) @ plane.T


def event(
    offsets: np.ndarray,
    *,
    axes: np.ndarray = AXES,
    centre: np.ndarray = CENTRE,
    error_s: float = 0.02,
    rng: np.random.Generator | None = None,
    negative: tuple[float, ...] = (),
    start: float = START_JD,
) -> Occultation:
    """Chords at these distances from the centre, in the direction (−0.9, 0.4), of the ellipse."""
    along = np.array([-0.9, 0.4]) / np.hypot(0.9, 0.4)
    left = np.array([-along[1], along[0]])
    light_time = np.linalg.norm(TO_EARTH) / LIGHT_KM_S / 86400.0
    q = np.linalg.inv(ellipse(axes, start - light_time))
    rows, places, kinds = [], [], []
    for b in (*offsets, *negative):
        missed = b in negative
        # (b left + s along) on the ellipse: a quadratic equation in s
        quadratic = [along @ q @ along, 2.0 * b * (left @ q @ along), b * b * (left @ q @ left) - 1]
        s = np.array([-30.0, 30.0]) if missed else np.sort(np.roots(quadratic).real)
        if rng is not None and not missed:
            s = s + SPEED * error_s * rng.normal(size=2)
        rows.append(start + (s - s.mean()) / SPEED / 86400.0)
        places.append(centre + b * left + s[:, None] * along)
        kinds.append(missed)
    return Occultation(
        TO_EARTH,
        np.zeros(3),
        np.array(rows),
        np.full((len(rows), 2), error_s),
        np.array(places),
        np.array(kinds),
    )


def text(events: list[Occultation]) -> str:
    """The events as a file of chords."""
    lines = [str(len(events))]
    for e in events:
        lines += [" ".join(map(str, e.to_earth_km)), "1 2 3", "17.27", str(len(e.negative))]
        for c, negative in enumerate(e.negative):
            cells = [e.jd[c, 0], e.error_s[c, 0], *e.place_km[c, 0]]
            cells += [e.jd[c, 1], e.error_s[c, 1], *e.place_km[c, 1]]
            lines.append(" ".join(repr(float(x)) for x in cells) + (" -1" if negative else " 3"))
    return "\n".join([*lines, "# a comment", ""])


def posterior(
    n_facets: int = 150, draws: int = 30, scatter: float = 0.02, seed: int = 4
) -> xr.DataTree:
    """Two solutions of equal weight: bodies about the truth at the pole and at another pole."""
    rng = np.random.default_rng(seed)
    normals = facets.grid(n_facets)
    harmonics = facets.spherical_harmonics(normals, 4)

    def mode(pole: tuple[float, float]) -> xr.Dataset:
        axes = AXES * np.exp(scatter * rng.normal(size=(1, draws, 1, 3)))
        areas = np.prod(axes, -1) ** 2 / np.sum((normals * axes) ** 2, -1) ** 2
        areas *= 8.0 / areas.sum(-1, keepdims=True)
        fitted = np.linalg.lstsq(harmonics, np.log(areas[0]).T, rcond=None)[0].T[None, :, 1:]
        spread = 0.3 * rng.normal(size=(2, 1, draws))
        names = ("chain", "draw")
        return xr.Dataset(
            {
                "albedo_area": ((*names, "facet"), areas),
                "coefficients": ((*names, "coefficient"), fitted),
                "pole_lon_deg": (names, pole[0] + spread[0]),
                "pole_lat_deg": (names, pole[1] + spread[1]),
                "period_h": (names, PERIOD_H + 2e-6 * rng.normal(size=(1, draws))),
                "lambert_c": (names, np.full((1, draws), 0.1)),
            },
            {"chain": [0], "draw": np.arange(draws)},
        )

    modes = [mode(POLE), mode(MIRROR)]
    both = xr.concat(modes, "chain").assign_coords(
        chain=[0, 1], solution=("chain", [0, 1]), weight=("chain", [0.5, 0.5])
    )
    t = np.linspace(0.0, 20 * 365.25 * 86400.0, 50)
    constant = xr.Dataset({"t": ("time", t), "grid_normals": (("facet", "xyz"), normals)})
    tree = xr.DataTree.from_dict(
        {
            "posterior": both,
            "constant_data": constant,
            "modes/0/posterior": modes[0],
            "modes/1/posterior": modes[1],
        }
    )
    epoch = MIDDLE_JD - 0.5 * np.ptp(t) / 86400.0
    tree.attrs |= {"epoch_jd": epoch, "frame": "ecliptic-j2000", "kind": "flux"}
    return tree


def folder(path: Path, tree: xr.DataTree) -> Path:
    """A results folder with this posterior, trusted."""
    path.mkdir()
    tree.to_netcdf(path / "posterior.nc", engine="h5netcdf")
    summary = {"schema": 4, "task": "fit", "trusted": True, "reasons": []}
    (path / "summary.json").write_text(json.dumps(summary))
    return path
