"""Simulated light curves of debris that turns in low Earth orbit, with small faults of real data.

Plain NumPy, without any code of the package: circular orbits about a spherical Earth that rotates,
a low-precision Sun, flat Lambertian facets, and a body that turns at a constant rate. A `Fault`
breaks one assumption by a stated amount. The file that is written holds what an observer knows: the
recorded times, magnitudes and errors, and the directions that belong to the recorded times.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

EARTH_KM, MU_EARTH = 6378.137, 398600.4418  # km, km³/s²
DAY = 86400.0
SUN_V = -26.76  # V magnitude of the Sun at 1 au (Willmer 2018, Vega)
N_POINTS = 160
NOISE, BACKGROUND = 0.02, 0.004  # errors: of the flux itself, and of the mean flux
FAINTEST = 0.08  # of the mean flux; fainter points are not detected
MAX_PASSES, MAX_A_NIGHT = 6, 4
MIN_ELEVATION, TWILIGHT = np.radians(15.0), np.radians(-8.0)
INERTIA_RATIO = 1.6  # largest moment of inertia over the other two, of a body that nutates
LOBE_EXPONENT = 50.0
CORRELATION_S = 20.0


@dataclass(frozen=True)
class Fault:
    """A departure from the model's assumptions; each is 0 (or 1 for ``error_factor``) by default.

    Attributes
    ----------
    zero_point : mag, added to the magnitudes of the second site
    clock : s, added to the times that the second site records
    nutation : deg, angle between the largest principal axis and the angular momentum
    rate_drift : relative change of the rate of rotation over the light curve
    lobe : share of a facet's reflected light that is in a specular lobe
    extra_facet : area of a fourth facet over the total of the other three
    correlated_noise : standard deviation of noise with a correlation time of 20 s, over that of the
        stated errors
    error_factor : true over stated errors
    """

    zero_point: float = 0.0
    clock: float = 0.0
    nutation: float = 0.0
    rate_drift: float = 0.0
    lobe: float = 0.0
    extra_facet: float = 0.0
    correlated_noise: float = 0.0
    error_factor: float = 1.0

    @property
    def needs_sites(self) -> int:
        """Number of sites without which the fault does not exist."""
        return 2 if self.zero_point or self.clock else 1


@dataclass(frozen=True)
class Body:
    """Lambertian facets and a constant angular velocity.

    The normals (N, 3) are in inertial axes at the time 0 of `Campaign`; ``areas`` (N,) are
    albedo-areas in m², and ``omega`` (3,) is in rad/s, inertial.
    """

    normals: Floats
    areas: Floats
    omega: Floats


@dataclass(frozen=True)
class Orbit:
    """A circular orbit and the sites that observe it; t is in s after ``jd``."""

    jd: float
    radius_km: float
    inclination: float
    node: float
    phase: float
    lat: Floats  # (S,) rad
    lon: Floats

    def satellite(self, t: Floats) -> Floats:
        """Geocentric position, km, (T, 3)."""
        u = self.phase + np.sqrt(MU_EARTH / self.radius_km**3) * t
        in_plane = np.stack([np.cos(u), np.sin(u), np.zeros_like(u)], axis=1)
        turn = about_z(self.node) @ about_x(self.inclination)
        return self.radius_km * in_plane @ turn.T

    def sites(self, t: Floats, which: Ints) -> Floats:
        """Geocentric positions of the sites ``which`` (T,) at the times t, km, (T, 3)."""
        angle = sidereal(self.jd + t / DAY) + self.lon[which]
        lat = self.lat[which]
        flat = np.cos(lat)
        return EARTH_KM * np.stack(
            [flat * np.cos(angle), flat * np.sin(angle), np.sin(lat)], axis=1
        )

    def view(self, t: Floats, which: Ints) -> tuple[Floats, Floats, Floats]:
        """Unit vectors to Sun and observer (T, 3), and the range in km (T,)."""
        line = self.sites(t, which) - self.satellite(t)
        distance = np.linalg.norm(line, axis=1)
        return sun_vector(self.jd + t / DAY)[0], line / distance[:, None], distance

    def visible(self, t: Floats, which: Ints) -> NDArray[np.bool_]:
        """Whether the satellite is high enough and lit, and the site dark."""
        sun, obs, _ = self.view(t, which)
        zenith = self.sites(t, which) / EARTH_KM
        satellite = self.satellite(t)
        along = np.sum(satellite * sun, axis=1)
        beside = np.linalg.norm(satellite - along[:, None] * sun, axis=1)
        high = -np.sum(obs * zenith, axis=1) > np.sin(MIN_ELEVATION)
        dark = np.sum(zenith * sun, axis=1) < np.sin(TWILIGHT)
        return high & dark & ((along > 0) | (beside > EARTH_KM))


@dataclass(frozen=True)
class Campaign:
    """The points of a light curve: time (s), site and pass of each, (T,)."""

    orbit: Orbit
    t: Floats
    site: Ints
    which_pass: Ints
    n_nights: int

    @property
    def n_sites(self) -> int:
        return len(self.orbit.lat)

    @property
    def n_passes(self) -> int:
        return len(np.unique(self.which_pass))


@dataclass(frozen=True)
class Case:
    """A simulated light curve with its truth.

    ``recorded`` are the times in s with the errors of the clocks. ``normals`` are those at the
    first recorded time and ``omega`` is the mean angular velocity; if the body nutates, both are
    those of its mean motion.
    """

    campaign: Campaign
    recorded: Floats
    magnitude: Floats
    error: Floats
    normals: Floats
    areas: Floats
    omega: Floats


def about_z(angle: float) -> Floats:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def about_x(angle: float) -> Floats:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def rotation(axis: Floats, angle: Floats) -> Floats:
    """Rotation matrices (T, 3, 3) about a unit axis (3,) by the angles (T,)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    s, c = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.eye(3) + s * cross + (1.0 - c) * cross @ cross


def sidereal(jd: Floats) -> Floats:
    """Greenwich mean sidereal time, rad (Meeus, Astronomical Algorithms, eq. 12.4)."""
    return np.radians(280.46061837 + 360.98564736629 * (jd - 2451545.0))


def sun_vector(jd: Floats) -> tuple[Floats, Floats]:
    """Unit vectors from the Earth to the Sun (T, 3) and distances in au (T,).

    References
    ----------
    The Astronomical Almanac, section C, low-precision formulae: 0.01° and 10⁻⁴ au.
    """
    n = np.asarray(jd, float) - 2451545.0
    g = np.radians(357.528 + 0.9856003 * n)
    lon = np.radians(280.460 + 0.9856474 * n + 1.915 * np.sin(g) + 0.020 * np.sin(2 * g))
    tilt = np.radians(23.439 - 4e-7 * n)
    y = np.sin(lon)
    vector = np.stack([np.cos(lon), np.cos(tilt) * y, np.sin(tilt) * y], axis=-1)
    return vector, 1.00014 - 0.01671 * np.cos(g) - 0.00014 * np.cos(2 * g)


def normals_at(body: Body, t: Floats, fault: Fault, start: float, end: float) -> Floats:
    """Normals in inertial axes at the times t, (T, N, 3).

    The rate is ω (1 + d (t − t_m)/T), with t_m the middle of start and end and T their difference:
    ω is the mean rate. A body that nutates is a symmetric top: its axis is at the angle θ from the
    angular momentum and circles it at the rate φ̇, while the body turns about the axis at
    ψ̇ = φ̇ cos θ (1/κ − 1), κ = I₃/I₁ (Goldstein, Classical Mechanics, sec. 5.6). φ̇ + ψ̇ is the
    rate of a body with θ = 0.
    """
    rate = float(np.linalg.norm(body.omega))
    axis = body.omega / rate
    middle, length = 0.5 * (start + end), max(end - start, 1e-9)
    angle = rate * (t + fault.rate_drift * ((t - middle) ** 2 - middle**2) / (2.0 * length))
    theta = np.radians(fault.nutation)
    if not theta:
        return np.einsum("tij,nj->tni", rotation(axis, angle), body.normals)
    precession = angle / (1.0 + np.cos(theta) * (1.0 / INERTIA_RATIO - 1.0))
    across = np.cross(axis, [0.3, 0.5, 0.8])
    across /= np.linalg.norm(across)
    tilt = rotation(across, np.array([theta]))
    turn = rotation(axis, precession) @ tilt @ rotation(axis, angle - precession)
    return np.einsum("tij,nj->tni", turn, body.normals)


def facet_flux(normals: Floats, areas: Floats, sun: Floats, obs: Floats, lobe: float) -> Floats:
    """Flux of each facet at unit distance and irradiance, (T, N).

    α μ₀ μ/π for a lit and visible facet. The first facet reflects the share ``lobe`` in a
    Blinn–Phong lobe, α (n + 2)/2π (n·h)ⁿ μ₀ μ, instead.
    """
    mu0 = np.maximum(np.einsum("tni,ti->tn", normals, sun), 0.0)
    mu = np.maximum(np.einsum("tni,ti->tn", normals, obs), 0.0)
    shared = areas * mu0 * mu
    flux = shared / np.pi
    if lobe:
        half = sun + obs
        half /= np.linalg.norm(half, axis=1, keepdims=True)
        glint = np.maximum(np.sum(normals[:, 0] * half, axis=1), 0.0) ** LOBE_EXPONENT
        shine = (LOBE_EXPONENT + 2.0) / (2.0 * np.pi) * glint
        flux[:, 0] = shared[:, 0] * ((1.0 - lobe) / np.pi + lobe * shine)
    return flux


def magnitudes(flux: Floats, range_km: Floats, sun_au: Floats) -> Floats:
    """m = m☉ − 2.5 log₁₀(e f/r²), e = (1 au/d)²."""
    return SUN_V - 2.5 * np.log10(flux / sun_au**2 / (1e3 * range_km) ** 2)


def draw_orbit(rng: np.random.Generator, n_sites: int) -> Orbit:
    """A random orbit, date and observatory; the other sites are within some hundred kilometres."""
    lat, lon = np.radians(rng.uniform(-55.0, 55.0)), rng.uniform(0.0, 2 * np.pi)
    away = np.radians(rng.uniform(1.0, 4.0, n_sites)) * rng.choice([-1.0, 1.0], n_sites)
    aside = np.radians(rng.uniform(1.0, 4.0, n_sites)) * rng.choice([-1.0, 1.0], n_sites)
    away[0] = aside[0] = 0.0
    return Orbit(
        jd=2460310.5 + rng.uniform(0.0, 366.0),
        radius_km=EARTH_KM + rng.uniform(700.0, 1500.0),
        inclination=np.radians(rng.choice([52.0, 66.0, 74.0, 82.0, 98.5])),
        node=rng.uniform(0.0, 2 * np.pi),
        phase=rng.uniform(0.0, 2 * np.pi),
        lat=lat + away,
        lon=lon + aside,
    )


def draw_campaign(
    rng: np.random.Generator,
    n_sites: int,
    n_passes: int,
    n_nights: int,
    n_points: int = 4 * N_POINTS,
) -> Campaign:
    """Random visible passes with these numbers; ``n_points`` times, evenly over what is visible."""
    step = 15.0
    for _ in range(2000):
        orbit = draw_orbit(rng, n_sites)
        t = np.arange(0.0, n_nights * DAY + 0.5 * DAY, step)
        up = np.stack([orbit.visible(t, np.full(t.size, k)) for k in range(n_sites)])
        rows = np.flatnonzero(np.any(up, axis=0))
        runs = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1) if rows.size else []
        runs = [r for r in runs if t[r[-1]] - t[r[0]] >= 180.0]
        starts = np.array([t[r[0]] for r in runs])
        night = np.concatenate([[0], np.cumsum(np.diff(starts) > 0.35 * DAY)]) if runs else starts
        if len(np.unique(night)) < n_nights or np.sum(night < n_nights) < n_passes:
            continue
        chosen = [int(rng.choice(np.flatnonzero(night == k))) for k in range(n_nights)]
        others = [k for k in np.flatnonzero(night < n_nights) if k not in chosen]
        chosen += [int(k) for k in rng.permutation(others)[: n_passes - n_nights]]
        result = _points(
            rng,
            orbit,
            [(float(t[runs[k][0]]), float(t[runs[k][-1]])) for k in sorted(chosen)],
            n_points,
        )
        counts = np.bincount(result[1], minlength=n_sites)
        if len(result[0]) >= 0.9 * n_points and counts.min() >= 0.15 * n_points / n_sites:
            return Campaign(orbit, *result, n_nights)
    raise RuntimeError(f"no orbit with {n_passes} passes in {n_nights} nights")


def _points(
    rng: np.random.Generator, orbit: Orbit, spans: list[tuple[float, float]], n: int
) -> tuple[Floats, Ints, Ints]:
    """Times, sites and passes of n points; the sites alternate."""
    n_sites = len(orbit.lat)
    length = np.array([b - a for a, b in spans])
    each = np.maximum(np.round(1.15 * n * length / length.sum()).astype(int), 8)
    t = np.concatenate(
        [a + (b - a) * (np.arange(k) + 0.5) / k for (a, b), k in zip(spans, each, strict=True)]
    )
    which = np.repeat(np.arange(len(spans)), each)
    t = t + rng.uniform(-0.2, 0.2, t.size) * np.repeat(length / each, each)
    site = np.arange(t.size) % n_sites
    seen = orbit.visible(t, site)
    return t[seen], site[seen], which[seen]


def draw_body(rng: np.random.Generator, n_facets: int = 3) -> Body:
    """Facets at least 25° apart with albedo-areas of 1 to 6 m², and a period of 40 to 240 s."""
    while True:
        normals = rng.normal(size=(n_facets, 3))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        if np.max(normals @ normals.T - 2 * np.eye(n_facets)) < np.cos(np.radians(25.0)):
            break
    axis = rng.normal(size=3)
    period = np.exp(rng.uniform(np.log(40.0), np.log(240.0)))
    areas = np.exp(rng.uniform(0.0, np.log(6.0), n_facets))
    return Body(normals, areas, 2 * np.pi / period * axis / np.linalg.norm(axis))


def draw_case(fault: Fault, seed: int, n_points: int = N_POINTS) -> Case:
    """A random campaign and body, observed with the fault.

    One to three sites and nights, and one to six passes, are drawn; up to four passes in a night.
    The campaign does not depend on the fault, except that some faults need two sites. The points
    are those at which the body with its fault is bright; where they are too few, another is drawn.
    """
    rng = np.random.default_rng([20240101, seed])
    n_sites = int(rng.integers(fault.needs_sites, 4))
    n_nights = int(rng.integers(1, 4))
    n_passes = int(rng.integers(n_nights, min(MAX_PASSES, MAX_A_NIGHT * n_nights) + 1))
    while True:
        campaign = draw_campaign(rng, n_sites, n_passes, n_nights)
        for _ in range(50):
            body = draw_body(rng)
            if (rows := detected(campaign, body, n_points, fault)) is not None:
                noise_rng = np.random.default_rng([20240101, seed, 1])
                return observe(noise_rng, campaign, body, fault, rows)


def detected(campaign: Campaign, body: Body, n_points: int, fault: Fault) -> Ints | None:
    """Points of the campaign at which the body is bright, thinned to ``n_points``.

    None if there are too few of them, a pass or a site has hardly any, or a facet does not show:
    each reflects more than 4 % of the mean flux in at least 8 % of the points.
    """
    t = campaign.t
    sun, obs, _ = campaign.orbit.view(t, campaign.site)
    normals = normals_at(body, t, fault, t.min(), t.max())
    each = facet_flux(normals, body.areas, sun, obs, fault.lobe)
    flux = each.sum(axis=1)
    bright = np.flatnonzero(flux > FAINTEST * flux.mean())
    if len(bright) < n_points:
        return None
    kept = bright[np.linspace(0, len(bright) - 1, n_points).round().astype(int)]
    shows = np.mean(each[kept] > 0.04 * flux.mean(), axis=0)
    used = np.bincount(campaign.site[kept], minlength=campaign.n_sites)
    every_pass = len(np.unique(campaign.which_pass[kept])) == campaign.n_passes
    few = used.min() < 0.1 * n_points / campaign.n_sites
    return kept if shows.min() >= 0.08 and every_pass and not few else None


def observe(
    rng: np.random.Generator, campaign: Campaign, body: Body, fault: Fault, rows: Ints
) -> Case:
    """The light curve with the fault, at some points of the campaign."""
    t, site = campaign.t[rows], campaign.site[rows]
    recorded = t + np.where(site == 1, fault.clock, 0.0)
    noise = fault.error_factor * rng.standard_normal(t.size)
    noise += fault.correlated_noise * correlated(rng, t, CORRELATION_S)
    extra = rng.normal(size=3)
    whole = body
    if fault.extra_facet:
        normals = np.vstack([body.normals, extra / np.linalg.norm(extra)])
        areas = np.append(body.areas, fault.extra_facet * body.areas.sum())
        whole = Body(normals, areas, body.omega)
    span = float(campaign.t.min()), float(campaign.t.max())
    sun, obs, distance = campaign.orbit.view(t, site)
    each = facet_flux(normals_at(whole, t, fault, *span), whole.areas, sun, obs, fault.lobe)
    flux = np.maximum(each.sum(axis=1), 0.1 * FAINTEST * each.sum(axis=1).mean())
    error = 2.5 / np.log(10.0) * np.hypot(NOISE, BACKGROUND * flux.mean() / flux)
    magnitude = magnitudes(flux, distance, sun_vector(campaign.orbit.jd + t / DAY)[1])
    magnitude += np.where(site == 1, fault.zero_point, 0.0) + error * noise
    steady = replace(fault, nutation=0.0)
    first = np.array([recorded.min()])
    order = np.argsort(recorded, kind="stable")
    # The mean rate over the points is that in the middle of them, not of the campaign.
    later = (0.5 * (t.min() + t.max()) - 0.5 * sum(span)) / max(span[1] - span[0], 1e-9)
    return Case(
        replace(
            campaign, t=t[order], site=site[order], which_pass=campaign.which_pass[rows][order]
        ),
        recorded[order],
        magnitude[order],
        error[order],
        normals_at(body, first, steady, *span)[0],
        body.areas,
        body.omega * (1.0 + fault.rate_drift * later),
    )


def correlated(rng: np.random.Generator, t: Floats, time: float) -> Floats:
    """An Ornstein–Uhlenbeck process of unit variance at the times t (T,)."""
    order = np.argsort(t, kind="stable")
    z = rng.standard_normal(t.size)
    for before, i in pairwise(order):
        decay = np.exp((t[before] - t[i]) / time)
        z[i] = decay * z[before] + np.sqrt(1.0 - decay**2) * z[i]
    return z


def write(case: Case, path: Path) -> None:
    """The light curve as a CSV file with directions, which are those of the recorded times."""
    orbit, site = case.campaign.orbit, case.campaign.site
    sun, obs, distance = orbit.view(case.recorded, site)
    lines = [
        "# frame: icrs",
        "jd,mag,mag_err,sun_x,sun_y,sun_z,obs_x,obs_y,obs_z,range_km,site",
    ]
    for i, name in enumerate(np.array(["A", "B", "C"])[site]):
        numbers = [
            orbit.jd + case.recorded[i] / DAY,
            case.magnitude[i],
            case.error[i],
            *sun[i],
            *obs[i],
            distance[i],
        ]
        lines.append(",".join([*(repr(float(x)) for x in numbers), str(name)]))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
