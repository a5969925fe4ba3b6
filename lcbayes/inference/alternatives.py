"""Departures from a model that may explain a misfit, as changes of the predicted brightness.

Each alternative is a set of columns (K, T): the changes of the brightness, in units of its
standard deviation, by unit amounts of a fault. Its amount then follows in closed form from the
residuals (a score test), without another fit.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lcbayes.core.constants import DAY_S, HOUR_S
from lcbayes.core.jax_setup import jnp
from lcbayes.data.lightcurve import LightCurve
from lcbayes.data.observers import calibrations, observers
from lcbayes.data.segments import APPARITION, PASS, split
from lcbayes.geometry.times import date
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.likelihood import FLUX
from lcbayes.modelling.nutation import in_phase
from lcbayes.modelling.problem import Problem, compiled
from lcbayes.modelling.recorded import Sites
from lcbayes.physics.bodies import facets
from lcbayes.physics.brightness import DiffuseLaw, diffuse_kernel

Floats = NDArray[np.float64]

CLOCK_STEP_S, ANGLE_STEP = 1e-3, 1e-4  # of differences; brightness is smooth over both
# Changes up to which the brightness is nearly linear in them.
LINEAR_MAG, LINEAR_TURN = 0.5, 0.15  # mag; rad
NOTCHES = (0.05, 0.15, 0.5, 2.0, 7.0, 20.0)  # height of the wall over the depth of the floor
LARGEST = 6  # facets that may form notches
FLATTEST = 1e-3  # cosine of the angle of incidence or emission for the longest shadow
UPRIGHT = 0.5  # cosine between their normals, at most
LOBES = (10.0, 30.0, 100.0)  # exponents of the cosine between normal and bisector
GRID = 96  # directions of a further facet
LAWS: dict[str, DiffuseLaw] = {  # the second without its term of Lambert
    "Lambert's law": "lambertian",
    "the law of Lommel and Seeliger": "lommel-seeliger-lambert",
    "the law of Ashikhmin and Shirley": "non-lambertian",
}
SAME_LAW = 1e-6  # of the mean flux: a law whose brightness differs by less is that of the model
MAX_FREQUENCIES = 256
LEAST_SLOPE = 4  # points of a pass with a slope of its own
MAX_NIGHTS = 6  # with nutation of their own
LATE_CURVE = "late-curve"
MAX_NAMED = 12  # observers, calibrations or passes of one with an alternative each


@dataclass(frozen=True)
class Alternative:
    """A fault of one kind.

    Attributes
    ----------
    name : str
        Code of the kind, such as ``zero-point``.
    about : str
        The part concerned, such as the name of a site.
    unit : str
        Unit of the amount.
    columns : (M, K, T)
        M versions of the fault (a frequency, a direction), each with K amounts.
    labels : tuple of M strings
        The version, for the sentence.
    one_sided : bool
        Whether the amounts can only be positive.
    reach : float
        Amount up to which the change of the brightness is nearly linear.
    """

    name: str
    about: str
    unit: str
    columns: Floats
    labels: tuple[str, ...] = ("",)
    one_sided: bool = False
    reach: float = np.inf


def names_of(curve: LightCurve) -> dict[str, tuple[str, ...]]:
    """Names of observers, calibrations and curves, as `alternatives` expects them."""
    seen_by = observers(curve)
    groups = calibrations(curve, seen_by)
    return {
        "observers": seen_by.names,
        "calibrations": groups.names,
        "series": groups.series_names,
        "curves": curve.dated_titles,
        "apparitions": _dated_apparitions(curve),
    }


def _dated_apparitions(curve: LightCurve) -> tuple[str, ...]:
    """Each apparition of each curve by its first and last day, in the order of `split`."""
    names = curve.dated_titles
    labels = []
    for rows in split(curve.t, curve.curve, APPARITION):
        first, last = (float(curve.t[rows[i]]) / DAY_S for i in (0, -1))
        if curve.epoch_jd is not None:
            when = f"{date(curve.epoch_jd + first)} to {date(curve.epoch_jd + last)}"
        else:
            when = f"days {first:.0f} to {last:.0f}"
        labels.append(f"{names[curve.curve[rows[0]]]} from {when}")
    return tuple(labels)


def alternatives(
    problem: Problem,
    z: Floats,
    data: Epochs,
    names: dict[str, tuple[str, ...]],
    kinds: tuple[str, ...] = (),
) -> list[Alternative]:
    """The faults that the data may contain, at the point z (D,).

    Parameters
    ----------
    names : mapping
        From `names_of`.
    kinds : tuple of str
        Only these names of alternatives; all by default.
    """
    sites = compiled(problem.constrain)(jnp.asarray(z), data)
    flux = np.asarray(sites[FLUX])
    spin = float(np.linalg.norm(np.asarray(sites.get("omega", 0.0))))
    candidates = [*_calibration(flux, data, names), *_pass_slopes(flux, data, names)]
    candidates += _clocks(problem, z, data, names, spin)
    if spin > 0.0:
        candidates += _drift(problem, z, data, spin)
        if not kinds or "nutation" in kinds:
            candidates += _nutation(problem, z, data, sites)
    if "period_h" in sites and (not kinds or LATE_CURVE in kinds):
        candidates += _late_curve(problem, z, data, names["curves"], float(sites["period_h"]))
    if "period_h" in sites and not kinds:
        apparitions = [*_apparitions(flux, data, names["apparitions"])]
        # one of a single night stands for the zero point of that night
        same = {column.tobytes() for one in apparitions for column in one.columns}
        candidates = [one for one in candidates if one.columns.tobytes() not in same]
        candidates += apparitions
    if {"sun_body", "normals"} <= sites.keys() and not kinds:
        base = np.asarray(sites.get("normals_base", sites["normals"]))
        # in the axes of the directions, which coincide with the inertial ones at another time
        own = {**sites, "normals": base / np.linalg.norm(base, axis=1, keepdims=True)}
        at_start = Rotation.align_vectors(np.asarray(sites["normals"]), own["normals"])[0]
        candidates += [*_lobes(own), *_further_facet(own, at_start), *_notches(own)]
        candidates += _laws(flux, own)
    candidates = [one for one in candidates if not kinds or one.name in kinds]
    candidates = [one for one in candidates if np.any(one.columns)]
    return _in_units_of_noise(problem, z, data, candidates) if candidates else []


def shadows(problem: Problem, z: Floats, data: Epochs, change: Floats | None) -> list[Alternative]:
    """Shadows of parts on one another that change the flux by (T,) at z; an amount of 1 is all."""
    if change is None or not np.any(change):
        return []
    one = Alternative("shadows", "", "", change[None, None], one_sided=True)
    return _in_units_of_noise(problem, z, data, [one])


def _in_units_of_noise(
    problem: Problem, z: Floats, data: Epochs, every: list[Alternative]
) -> list[Alternative]:
    """Columns of flux as columns of the brightness over its sd, given earlier points."""
    flat = [one.columns.reshape(-1, one.columns.shape[-1]) for one in every]
    changed = compiled(problem.response)(jnp.asarray(z), data, jnp.asarray(np.concatenate(flat)))
    parts = np.split(np.asarray(changed), np.cumsum([len(rows) for rows in flat])[:-1])
    return [
        replace(one, columns=rows.reshape(one.columns.shape))
        for one, rows in zip(every, parts, strict=True)
    ]


def _calibration(
    flux: Floats, data: Epochs, names: dict[str, tuple[str, ...]]
) -> Iterator[Alternative]:
    """Each observer, and each calibration, is fainter by an amount in mag."""
    seen = set()
    for index, which in ((data.observer, "observers"), (data.calibration, "calibrations")):
        each = np.asarray(index)
        for k, name in enumerate(names[which][:MAX_NAMED]):
            here = each == k
            if here.all() or (key := here.tobytes()) in seen:
                continue
            seen.add(key)
            column = np.where(here, -0.4 * np.log(10.0) * flux, 0.0)
            yield Alternative("zero-point", name, "mag", column[None, None], reach=LINEAR_MAG)
    phase = np.asarray(data.phase_angle)
    if np.ptp(phase) > 0.1:
        column = -0.4 * np.log(10.0) * flux * (phase - phase.mean())
        reach = LINEAR_MAG / np.ptp(phase)
        yield Alternative("phase-slope", "", "mag/rad", column[None, None], reach=reach)


def _pass_slopes(
    flux: Floats, data: Epochs, names: dict[str, tuple[str, ...]]
) -> Iterator[Alternative]:
    """An observer becomes fainter along each of its passes, as by extinction that is left in.

    The amounts are mag from the middle of a pass to its end, one for each pass; the length of their
    vector is their root mean square.
    """
    observer, t = np.asarray(data.observer), np.asarray(data.t)
    passes = split(t, observer, PASS)
    passes = [rows for rows in passes if rows.size >= LEAST_SLOPE and np.ptp(t[rows]) > 0.0]
    several = data.n_observers > 1
    for k, name in enumerate(names["observers"][:MAX_NAMED]):
        own = [rows for rows in passes if observer[rows[0]] == k]
        if not 0 < len(own) <= MAX_NAMED:
            continue
        columns = np.zeros((len(own), t.size))
        for column, rows in zip(columns, own, strict=True):
            since = t[rows] - 0.5 * (t[rows[0]] + t[rows[-1]])
            column[rows] = -0.4 * np.log(10.0) * flux[rows] * since / since[-1]
        about = name if several else "the points"
        unit = np.sqrt(len(own))
        yield Alternative("pass-slope", about, "mag", unit * columns[None], reach=LINEAR_MAG)


def _clocks(
    problem: Problem, z: Floats, data: Epochs, names: dict[str, tuple[str, ...]], spin: float
) -> Iterator[Alternative]:
    """The times of an observer, or of one of its passes if the body spins, are late by s.

    ``spin`` is the rate of rotation, rad/s; 0 if the body does not rotate.

    The body axes are those at the first point. If the pass that holds it is late, so are they, and
    the attitude in all other passes is that of an earlier time.
    """
    observer, t = np.asarray(data.observer), np.asarray(data.t)
    passes = split(t, observer, PASS) if spin > 0.0 else []
    several = data.n_observers > 1
    if not several and len(passes) < 2:
        return
    rate, reach = _by_time(problem, z, data, moving=True), LINEAR_TURN / max(spin, 1e-300)
    for k, name in enumerate(names["observers"][:MAX_NAMED]):
        if several:
            column = np.where(observer == k, rate, 0.0)
            yield Alternative("clock", name, "s", column[None, None], reach=reach)
        own = [rows for rows in passes if observer[rows[0]] == k]
        of = f" of {name}" if several else ""
        for number, rows in enumerate(own[:MAX_NAMED] if len(own) > 1 else [], 1):
            column = np.zeros(t.size)
            column[rows] = rate[rows]
            if t[rows[0]] == t.min():
                column -= _by_time(problem, z, data, moving=False)
            about = f"pass {number}{of}"
            yield Alternative("late-pass", about, "s", column[None, None], reach=reach)


def _late_curve(
    problem: Problem, z: Floats, data: Epochs, names: tuple[str, ...], period_h: float
) -> Iterator[Alternative]:
    """The times of one curve are late by min: each curve in turn, as one version."""
    here = np.asarray(data.curve) == np.arange(len(names))[:, None]
    if len(names) > 1:
        columns = np.where(here, 60.0 * _by_time(problem, z, data, moving=True), 0.0)
        reach = LINEAR_TURN * period_h * HOUR_S / (2.0 * np.pi * 60.0)
        yield Alternative(LATE_CURVE, "", "min", columns[:, None], names, reach=reach)


def _apparitions(flux: Floats, data: Epochs, names: tuple[str, ...]) -> Iterator[Alternative]:
    """One curve is fainter by an amount in mag in one of its apparitions: each in turn."""
    t, curve = np.asarray(data.t), np.asarray(data.curve)
    columns, labels = [], []
    for rows, name in zip(split(t, curve, APPARITION), names, strict=True):
        if 1 < rows.size < np.sum(curve == curve[rows[0]]):
            column = np.zeros((1, t.size))
            column[0, rows] = -0.4 * np.log(10.0) * flux[rows]
            columns.append(column)
            labels.append(name)
    if columns:
        yield Alternative(
            "faint-apparition", "", "mag", np.array(columns), tuple(labels), reach=LINEAR_MAG
        )


def _drift(problem: Problem, z: Floats, data: Epochs, spin: float) -> Iterator[Alternative]:
    """The rate of rotation changes over the light curve by a relative amount."""
    t, middle = np.asarray(data.t), float(data.t_middle)
    warp = ((t - middle) ** 2 - middle**2) / (2.0 * float(data.t_span))
    column = warp * _by_time(problem, z, data, moving=False)
    reach = LINEAR_TURN / max(0.01 * spin * float(np.max(np.abs(warp))), 1e-300)
    yield Alternative("rate-drift", "", "%", 0.01 * column[None, None], reach=reach)


def _nutation(problem: Problem, z: Floats, data: Epochs, sites: Sites) -> Iterator[Alternative]:
    """Small torque-free nutation at any frequency that a rigid body can have.

    The columns of each version are those of `modelling.nutation.response`: four for each night,
    because the phase cannot be followed from night to night. The length of the vector of amounts is
    the angle by which the body is turned, deg, as a root mean square over time and nights.
    """
    omega = np.asarray(sites["omega"])
    rate = float(np.linalg.norm(omega))
    if rate == 0.0 or data.n_nights > MAX_NIGHTS or "inertia" in sites:  # of a torque-free body
        return
    pole = omega / rate
    across = np.stack(facets.across(pole[None])).reshape(2, 3)
    first, second = (_by_rotation(problem, z, data, axis) for axis in across)
    turn = rate * np.asarray(data.nights.elapsed)
    cos, sin = np.cos(turn), np.sin(turn)
    along = jnp.asarray([cos * first + sin * second, cos * second - sin * first])  # of body axes
    longest = rate * float(data.longest_night)
    n = int(np.clip(np.ceil(2.0 * longest / np.pi), 4, MAX_FREQUENCIES))
    ratio = (np.arange(n) + 0.5) / n
    each = np.array([in_phase(along, jnp.asarray(r * turn)) for r in ratio])
    here = np.asarray(data.night) == np.arange(data.n_nights)[:, None]
    columns = (each[:, None] * here[:, None]).reshape(n, -1, turn.size)
    unit = np.radians(np.sqrt(2.0 * data.n_nights))
    labels = tuple(f"{r:.4g} times the rate of rotation" for r in ratio)
    reach = float(np.degrees(LINEAR_TURN))
    yield Alternative("nutation", "", "deg", unit * columns, labels, reach=reach)


def _lobes(sites: Sites) -> Iterator[Alternative]:
    """A facet, or every facet, has a specular lobe.

    The amount is that of its peak over the diffuse reflectance.
    """
    normals, area = (np.asarray(sites[k]) for k in ("normals", "albedo_area"))
    sun, obs = (np.asarray(sites[k]) for k in ("sun_body", "obs_body"))
    bisector = sun + obs
    bisector = bisector / np.linalg.norm(bisector, axis=1, keepdims=True)
    seen = (sun @ normals.T > 0) & (obs @ normals.T > 0)
    cosine = np.where(seen, np.maximum(bisector @ normals.T, 0.0), 0.0)
    each = area / np.pi * np.stack([cosine**n for n in LOBES])
    labels = tuple(f"exponent {n:.0f}" for n in LOBES)
    parts = [(f"facet {i}", each[..., i]) for i in range(len(area))]
    if len(area) > 1:
        parts.append(("every facet", each.sum(axis=-1)))
    for about, columns in parts:
        yield Alternative("lobe", about, "", columns[:, None], labels, one_sided=True)


def _laws(flux: Floats, sites: Sites) -> Iterator[Alternative]:
    """All facets scatter by another diffuse law, in part; the total light is kept.

    The laws are Lambert's, μ₀μ, that of Lommel and Seeliger, μ₀μ/(μ₀ + μ), and that of Ashikhmin
    and Shirley, [1 − (1 − μ₀/2)⁵][1 − (1 − μ/2)⁵] μ₀μ. That of the model itself changes nothing.
    """
    mu0, mu = (sites[k] @ sites["normals"].T for k in ("sun_body", "obs_body"))
    columns, labels = [], []
    for name, law in LAWS.items():
        light = np.asarray(diffuse_kernel(law, mu0, mu, 0.0)[0] @ sites["albedo_area"])
        change = light * (flux.mean() / max(light.mean(), 1e-300)) - flux
        if np.ptp(change) > SAME_LAW * flux.mean():
            columns.append(change[None])
            labels.append(name)
    if columns:
        yield Alternative("law", "", "", np.array(columns), tuple(labels), one_sided=True)


def _further_facet(sites: Sites, at_start: Rotation) -> Iterator[Alternative]:
    """The body has a further diffuse facet, of an albedo-area in m²; ``at_start`` turns its normal
    to the axes at t = 0."""
    normals = facets.grid(GRID)
    sun, obs = (np.asarray(sites[k]) @ normals.T for k in ("sun_body", "obs_body"))
    columns = np.where((sun > 0) & (obs > 0), sun * obs, 0.0).T / np.pi
    seen = np.any(columns > 0, axis=1)
    phi, g = facets.angles(jnp.asarray(at_start.apply(normals[seen])))
    labels = tuple(
        f"phi {p:.1f}, g {c:.1f}" for p, c in zip(np.asarray(phi), np.asarray(g), strict=True)
    )
    if seen.any():
        yield Alternative("facet", "", "m²", columns[seen][:, None], labels, one_sided=True)


def _notches(sites: Sites) -> Iterator[Alternative]:
    """Two facets stand on one another and shade and hide one another, as no convex body does.

    A wall of height h at one end of a floor of depth d, both much longer than that, shades or hides
    the share min(1, (h/d) m) of the floor. Here m = max(−v·n_wall, 0)/(v·n_floor), for v to the Sun
    or the observer, whichever is larger: both shares begin at the foot of the wall. The floor
    shades the wall likewise with d/h. The two amounts are the shares of the facets in the notch.
    """
    normals, area = (np.asarray(sites[k]) for k in ("normals", "albedo_area"))
    chosen = np.sort(np.argsort(-area, kind="stable")[:LARGEST])
    sun, obs = (np.asarray(sites[k]) @ normals[chosen].T for k in ("sun_body", "obs_body"))
    light = np.where((sun > 0) & (obs > 0), area[chosen] / np.pi * sun * obs, 0.0)
    columns, labels = [], []
    for i, j in combinations(range(len(chosen)), 2):
        if abs(normals[chosen[i]] @ normals[chosen[j]]) > UPRIGHT:
            continue
        on_i, on_j = (_steepness(sun, obs, *pair) for pair in ((i, j), (j, i)))
        for ratio in NOTCHES:
            first = light[:, i] * np.minimum(1.0, ratio * on_i)
            second = light[:, j] * np.minimum(1.0, on_j / ratio)
            columns.append(-np.stack([first, second]))
            labels.append(f"facets {chosen[i]} and {chosen[j]}")
    if columns:
        yield Alternative("notch", "", "", np.array(columns), tuple(labels), one_sided=True)


def _steepness(sun: Floats, obs: Floats, floor: int, wall: int) -> Floats:
    """Length of the shadow of a wall of unit height on a floor, or of what it hides, (T,)."""
    tangents = [
        np.maximum(-v[:, wall], 0.0) / np.maximum(v[:, floor], FLATTEST) for v in (sun, obs)
    ]
    return np.maximum(*tangents)


def _by_time(problem: Problem, z: Floats, data: Epochs, *, moving: bool) -> Floats:
    """Rate of change (T,) of the flux with the time of each point, 1/s.

    ``moving``: the directions change with time too, at the rates of the data.
    """

    def at(step: float) -> Floats:
        t = data.t + step
        later = replace(data, t=t, orbit=data.orbit._replace(t=t))
        if moving:
            later = replace(
                later,
                sun=_unit(data.sun + step * data.sun_rate),
                obs=_unit(data.obs + step * data.obs_rate),
            )
        return np.asarray(compiled(problem.flux_at)(jnp.asarray(z), later))

    return (at(CLOCK_STEP_S) - at(-CLOCK_STEP_S)) / (2.0 * CLOCK_STEP_S)


def _by_rotation(problem: Problem, z: Floats, data: Epochs, axis: Floats) -> Floats:
    """Derivative (T,) of the flux by the angle of a rotation of the body about an inertial axis."""

    def at(angle: float) -> Floats:
        sun, obs = (_unit(v - angle * jnp.cross(axis, v)) for v in (data.sun, data.obs))
        turned = replace(data, sun=sun, obs=obs)
        return np.asarray(compiled(problem.flux_at)(jnp.asarray(z), turned))

    return (at(ANGLE_STEP) - at(-ANGLE_STEP)) / (2.0 * ANGLE_STEP)


def _unit(v):
    return v / jnp.linalg.norm(v, axis=-1, keepdims=True)
