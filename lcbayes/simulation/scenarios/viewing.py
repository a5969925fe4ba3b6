"""Viewing geometry of a scenario, as specified in the scenario file."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from lcbayes.core.toml import Table
from lcbayes.data.lightcurve import FRAMES
from lcbayes.geometry.tle import Tle, parse_tle, read_tle

PLANES = ("xy", "yz", "zx")
MAX_EPOCHS = 1_000_000
MAX_TIME_S = 1e10  # 300 years
MAX_RATE = 1e3  # rad/s
MAX_ANGLE = 1e6  # rad
RANGES_KM = (1e-3, 1e12)


@dataclass(frozen=True)
class PlanarPass:
    """Directions that rotate in a plane: u = [cos(ω t + λ), sin(ω t + λ), 0] in its axes.

    The Sun moves in xy, the observer in `plane`: "xy", "yz" (x → y, y → z) or "zx".

    References
    ----------
    Linares & Crassidis, eq. (31); the second, orthogonal pass of sec. VII.A.
    """

    start: float  # s
    stop: float  # s, included
    step: float  # s
    omega_obs: float  # rad/s
    lambda_obs: float  # rad
    omega_sun: float
    lambda_sun: float
    plane: str


@dataclass(frozen=True)
class Planar:
    """One or several passes with directions in a plane; the range is in km or unknown."""

    passes: tuple[PlanarPass, ...]
    frame: str
    range_km: float | None


@dataclass(frozen=True)
class NamedSite:
    """A site on the Earth: geodetic latitude, east longitude and height above the ellipsoid."""

    name: str
    lat_deg: float
    lon_deg: float
    height_m: float


@dataclass(frozen=True)
class OrbitPass:
    """Observations of one site: times in UTC, step in s, and limits of elevation."""

    site: NamedSite
    start: datetime
    stop: datetime
    step: float
    min_elevation_deg: float
    max_sun_elevation_deg: float


@dataclass(frozen=True)
class Orbit:
    """A satellite on the orbit of a two-line element set, seen from sites on the ground."""

    tle: Tle
    passes: tuple[OrbitPass, ...]


@dataclass(frozen=True)
class Vectors:
    """Epochs and directions from a light-curve file; its brightness is not used."""

    file: Path


DIRECTION_KEYS = ("omega_obs", "lambda_obs", "omega_sun", "lambda_sun")
PLANAR_KEYS = ("start", "stop", "step", "plane", *DIRECTION_KEYS)
ORBIT_KEYS = ("site", "start", "stop", "step", "min_elevation_deg", "max_sun_elevation_deg")


def read_geometry(table: Table) -> Planar | Orbit | Vectors:
    """The geometry of the table [geometry], which holds defaults for [[geometry.passes]]."""
    kind = table.text("kind", choices=("planar", "orbit", "vectors"))
    if kind == "vectors":
        viewing = Vectors(table.path.parent / table.text("file"))
    elif kind == "planar":
        viewing = Planar(
            tuple(_planar_pass(item) for item in _passes(table, PLANAR_KEYS)),
            table.text("frame", "inertial", FRAMES),
            table.number("range_km", None, *RANGES_KM),
        )
    else:
        viewing = Orbit(
            _tle(table), tuple(_orbit_pass(item) for item in _passes(table, ORBIT_KEYS))
        )
    table.done()
    return viewing


def _passes(table: Table, keys: tuple[str, ...]) -> list[Table]:
    inner = table.tables("passes")
    return [item.under(table, keys) for item in inner or [table.blank()]]


def _planar_pass(table: Table) -> PlanarPass:
    start = table.number("start", 0.0, -MAX_TIME_S, MAX_TIME_S)
    stop = table.number("stop", low=-MAX_TIME_S, high=MAX_TIME_S)
    step = table.number("step", above=0.0)
    _check_span(table, stop - start, step)
    most = {key: MAX_RATE if key.startswith("omega") else MAX_ANGLE for key in DIRECTION_KEYS}
    directions = {key: table.number(key, low=-high, high=high) for key, high in most.items()}
    transit = PlanarPass(start, stop, step, plane=table.text("plane", "xy", PLANES), **directions)
    table.done()
    return transit


def _orbit_pass(table: Table) -> OrbitPass:
    site = _site(table)
    start, stop = table.instant("start"), table.instant("stop")
    step = table.number("step", above=0.0)
    _check_span(table, (stop - start).total_seconds(), step)
    transit = OrbitPass(
        site,
        start,
        stop,
        step,
        table.number("min_elevation_deg", 15.0, low=-90.0, high=90.0),
        table.number("max_sun_elevation_deg", -9.0, low=-90.0, high=90.0),
    )
    table.done()
    return transit


def _check_span(table: Table, span: float, step: float) -> None:
    if not span >= 0:
        raise table.fault("stop", "is before start; swap them")
    if span / step >= MAX_EPOCHS:
        raise table.fault(
            "step", f"is {step:g}, more than {MAX_EPOCHS:,} epochs; take a longer one"
        )


def _site(table: Table) -> NamedSite:
    site = table.table("site")
    named = NamedSite(
        site.text("name", ""),
        site.number("lat_deg", low=-90.0, high=90.0),
        site.number("lon_deg", low=-180.0, high=360.0),
        site.number("height_m", 0.0, low=-500.0, high=9000.0),
    )
    site.done()
    return named


def _tle(table: Table) -> Tle:
    """The element set, given in the scenario or in a file next to it."""
    text = table.text("tle")
    if "\n" in text.strip():
        return parse_tle(text, f"{table.path}: geometry.tle")
    return read_tle(table.path.parent / text)
