"""The file of a newcomer: a stage with two plates over three passes, by NumPy, SGP4 and Astropy.

The stage turns about its axis of largest inertia. Light is summed over small flat pieces of its
surface; a piece shines where no part stops the ray to the Sun or to the observer.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from astropy import units
from astropy.coordinates import GCRS, TEME, CartesianRepresentation, EarthLocation, get_sun
from astropy.time import Time
from astropy.utils import iers
from numpy.typing import NDArray
from sgp4.api import Satrec

Floats = NDArray[np.float64]

ELEMENTS = """\
1 99001U 26001A   26105.50000000  .00000120  00000-0  60000-4 0  9990
2 99001  98.1500 158.4316 0011000  90.0000  20.0000 14.60983543  1201
"""
SITE = (37.2236, -2.5463, 600.0)
PASSES = (
    ("2026-04-20T19:51:50", 221),
    ("2026-04-20T21:29:50", 201),
    ("2026-04-21T20:30:30", 301),
)
AIR_KM = 6438.0  # sunlight that passes above this distance from the Earth's centre is whole
PERIOD_S, POLE_DEG, PHASE = 23.7, (70.0, 25.0), np.radians(35.0)
ERROR = 0.05  # mag
RADIUS, LENGTH = 1.1, 6.5
TILT = np.radians(70.0)
ALONG, ACROSS = np.array([1.0, 0.0, 0.0]), np.array([0.0, np.cos(TILT), np.sin(TILT)])
NORMAL = np.cross(ALONG, ACROSS)
PLATES = (np.array([1.5, 0.0, 1.8]), np.array([1.5, 0.0, -1.8]))  # of 2 m by 1 m
PAINT, METAL, CELLS = (0.4, 0.1, 20.0), (0.25, 0.0, 0.0), (0.1, 0.3, 50.0)
BODY = """
title = "a stage with two plates"
[body]
material = "paint"
[[body.parts]]
kind = "cylinder"
radius = 1.1
length = 6.5
direction = [1, 0, 0]
end_material = "metal"
[[body.parts]]
kind = "plate"
x = 2.0
y = 1.0
position = [1.5, 0.0, 1.8]
rotation_deg = [70.0, 0.0, 0.0]
material = "cells"
back_material = "paint"
[[body.parts]]
kind = "plate"
x = 2.0
y = 1.0
position = [1.5, 0.0, -1.8]
rotation_deg = [70.0, 0.0, 0.0]
material = "cells"
back_material = "paint"
[materials.paint]
law = "ashikhmin-shirley"
r_diff = { low = 0.1, high = 0.9 }
r_spec = { low = 0.0, high = 0.3 }
nu = { median = 30, factor = 2 }
[materials.metal]
law = "lambertian"
r_diff = { low = 0.05, high = 0.9 }
[materials.cells]
law = "ashikhmin-shirley"
r_diff = { low = 0.02, high = 0.4 }
r_spec = { low = 0.0, high = 0.9 }
nu = { median = 30, factor = 2 }
"""

type Piece = tuple[Floats, Floats, float, tuple[float, float, float]]  # places, normals, area, law


def pieces() -> list[Piece]:
    """The side of the stage, its ends, and both sides of the plates."""
    x, azimuth = np.meshgrid(
        (np.arange(60) + 0.5) / 60 - 0.5, 2 * np.pi * (np.arange(96) + 0.5) / 96
    )
    out = np.stack([0 * azimuth, np.cos(azimuth), np.sin(azimuth)], axis=-1).reshape(-1, 3)
    at = RADIUS * out + LENGTH * x.reshape(-1, 1) * ALONG
    made: list[Piece] = [(at, out, 2 * np.pi * RADIUS * LENGTH / len(at), PAINT)]
    k = np.arange(600) + 0.5
    r, angle = RADIUS * np.sqrt(k / 600), k * np.pi * (3 - np.sqrt(5))
    for sign in (1.0, -1.0):
        at = np.stack([np.full(600, 0.5 * sign * LENGTH), r * np.cos(angle), r * np.sin(angle)], 1)
        made.append((at, np.tile(sign * ALONG, (600, 1)), np.pi * RADIUS**2 / 600, METAL))
    p, q = np.meshgrid((np.arange(40) + 0.5) / 20 - 1, (np.arange(20) + 0.5) / 20 - 0.5)
    for centre in PLATES:
        at = centre + p.reshape(-1, 1) * ALONG + q.reshape(-1, 1) * ACROSS
        for normal, law in ((NORMAL, CELLS), (-NORMAL, PAINT)):
            made.append((at, np.tile(normal, (len(at), 1)), 2.0 / len(at), law))
    return made


def stopped(x: Floats, d: Floats) -> NDArray[np.bool_]:
    """Which rays x + t d, t > 0, meet the stage or a plate."""
    a, b = d[1:] @ d[1:], x[:, 1:] @ d[1:]
    square = b**2 - a * (np.sum(x[:, 1:] ** 2, axis=1) - RADIUS**2)
    root, hit = np.sqrt(np.maximum(square, 0.0)), np.zeros(len(x), bool)
    for t in ((-b - root) / a, (-b + root) / a):
        hit |= (square > 0) & (t > 1e-6) & (np.abs(x[:, 0] + t * d[0]) < 0.5 * LENGTH)
    for end in (0.5 * LENGTH, -0.5 * LENGTH):
        t = (end - x[:, 0]) / d[0]
        hit |= (t > 1e-6) & (np.sum((x + t[:, None] * d)[:, 1:] ** 2, axis=1) < RADIUS**2)
    for centre in PLATES:
        t = (centre - x) @ NORMAL / (d @ NORMAL)
        p = x + t[:, None] * d - centre
        hit |= (t > 1e-6) & (np.abs(p @ ALONG) < 1.0) & (np.abs(p @ ACROSS) < 0.5)
    return hit


def flux(made: list[Piece], sun: Floats, obs: Floats) -> float:
    """m², by the law of Ashikhmin & Shirley (2000) with equal exponents, or Lambert's."""
    c = np.sqrt(0.5 + 0.5 * sun @ obs)
    total = 0.0
    for at, normals, area, (r_diff, r_spec, nu) in made:
        mu0, mu = normals @ sun, normals @ obs
        seen = np.flatnonzero((mu0 > 0) & (mu > 0))
        for d in (sun, obs):
            seen = seen[~stopped(at[seen], d)]
        mu0, mu = mu0[seen], mu[seen]
        law = r_diff / np.pi + 0.0 * mu
        if r_spec:
            fresnel = r_spec + (1 - r_spec) * (1 - c) ** 5
            lobe = (0.5 * (mu0 + mu) / c) ** nu / (c * np.maximum(mu0, mu))
            diffuse = (1 - (1 - mu0 / 2) ** 5) * (1 - (1 - mu / 2) ** 5)
            law = (nu + 1) / (8 * np.pi) * fresnel * lobe
            law += 28 * r_diff / (23 * np.pi) * (1 - r_spec) * diffuse
        total += area * float(np.sum(law * mu0 * mu))
    return total


def axes_of_inertia(made: list[Piece]) -> Floats:
    """Rows: the axis of the stage, and the axis of largest inertia of a shell as the third."""
    at = np.concatenate([piece[0] for piece in made])
    weight = np.concatenate([np.full(len(piece[0]), piece[2]) for piece in made])
    weight[-4 * 800 :] *= 0.5  # the two sides of a plate are one sheet
    at = at - weight @ at / weight.sum()
    tensor = np.eye(3) * (weight @ np.sum(at**2, axis=1)) - (at * weight[:, None]).T @ at
    third = np.linalg.eigh(tensor)[1][:, 2]
    first = np.cross(third, ALONG)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(third, first), third])


def directions(t: Time) -> tuple[Floats, Floats, Floats, Floats, NDArray[np.bool_]]:
    """Unit vectors to Sun and observer, distances in au and m, and whether the Sun is whole."""
    satellite = Satrec.twoline2rv(*ELEMENTS.splitlines())
    _, place, _ = satellite.sgp4_array(t.jd1, t.jd2)
    teme: Any = TEME(CartesianRepresentation(place.T * units.km), obstime=t)
    km = teme.transform_to(GCRS(obstime=t)).cartesian.xyz.to_value(units.km).T
    site: Any = EarthLocation.from_geodetic(SITE[1], SITE[0], SITE[2])
    sunlight: Any = get_sun(t)
    sun = sunlight.cartesian.xyz.to_value(units.km).T - km
    obs = site.get_gcrs(t).cartesian.xyz.to_value(units.km).T - km
    far, near = (np.linalg.norm(v, axis=1) for v in (sun, obs))
    sun, obs = sun / far[:, None], obs / near[:, None]
    height = np.linalg.norm(km, axis=1)
    behind = np.arccos(np.sum(-km * sun, axis=1) / height)  # of the Sun from the Earth's centre
    whole = behind > np.arcsin(AIR_KM / height) + 0.0047
    return sun, obs, far / units.au.to(units.km), 1e3 * near, whole


def write(folder: Path, seed: int = 1) -> None:
    """``tumbler.csv``, ``object.tle`` and ``stage.toml``."""
    with iers.conf.set_temp("auto_download", False), iers.conf.set_temp("auto_max_age", None):
        seconds = [Time(start).unix + np.arange(n) for start, n in PASSES]
        t = Time(np.concatenate(seconds), format="unix", scale="utc")
        sun, obs, au, metres, whole = directions(t)
        texts = t.iso
    lon, lat = np.radians(POLE_DEG)
    pole = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
    east = np.cross([0.0, 0.0, 1.0], pole) / np.cos(lat)
    made = pieces()
    axes, rng, rows = axes_of_inertia(made), np.random.default_rng(seed), []
    for k in np.flatnonzero(whole):
        turn = PHASE + 2 * np.pi * (t.unix[k] - t.unix[0]) / PERIOD_S
        x = np.cos(turn) * east + np.sin(turn) * np.cross(pole, east)
        to_body = axes.T @ np.stack([x, np.cross(pole, x), pole])
        bright = flux(made, to_body @ sun[k], to_body @ obs[k]) / (au[k] * metres[k]) ** 2
        mag = -26.74 - 2.5 * np.log10(bright) + ERROR * rng.standard_normal()
        rows.append(f"{texts[k]},{mag:.3f},{ERROR:.3f}")
    (folder / "tumbler.csv").write_text("\n".join(["Date/Time (UTC),mag,err", *rows, ""]))
    (folder / "object.tle").write_text(ELEMENTS)
    (folder / "stage.toml").write_text(BODY)
