"""Attitude information from glints: facets, a cylinder, or a panel that follows the Sun."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.errors import InputError
from lcbayes.core.reasons import Finding
from lcbayes.data.lightcurve import LightCurve
from lcbayes.data.segments import labels, nights
from lcbayes.inversion.albedo_area.observed import UNKNOWN_ERROR, Observed
from lcbayes.inversion.glints.detect import Baseline, Glint, detect
from lcbayes.inversion.glints.directions import (
    Direction,
    Sighting,
    Tracking,
    bisector,
    cylinder,
    facets,
    tracking,
)
from lcbayes.inversion.glints.instants import instants, rounding
from lcbayes.physics.attitude.laws import Attitude, Fixed

Floats = NDArray[np.float64]

MIN_FIT = 0.01  # nominal rate at which a true facet, cylinder or offset is rejected
NARROW = 0.5  # rad; largest semi-axis of the 90 % region of an accepted cylinder
WIDEST = np.radians(6.0)  # longest glint, as motion of the bisector
SPREAD = np.radians(15.0)  # least rms angle of the bisectors from their mean, for a cylinder


@dataclass(frozen=True)
class Glints:
    """Result of `analyse`.

    Attributes
    ----------
    t, flux : (U,)
        Data searched: flux at unit distance, with points of equal time averaged.
    baseline : level above which glints are detected
    glints, seen : in order of time; bisectors in body axes
    facets : facets shared by two or more glints, if any
    single : facets from one glint each
    cylinder : None if rejected
    panel : the offset from the Sun; None if not requested or rejected
    reasons : why there is no result, or no requested result
    notes : further remarks on the result
    """

    t: Floats
    flux: Floats
    baseline: Baseline
    glints: list[Glint]
    seen: list[Sighting]
    facets: list[Direction]
    single: list[Direction]
    cylinder: Direction | None
    panel: Tracking | None
    reasons: list[Finding]
    notes: list[str]


def analyse(
    curve: LightCurve,
    attitude: Attitude | None = None,
    *,
    axis: tuple[float, float, float] | None = None,
    alarm: float = 0.01,
    longest_s: float | None = None,
) -> Glints:
    """Find glints and solve the specular conditions over several of them.

    Parameters
    ----------
    curve : LightCurve
    attitude : Attitude
        Attitude of the body; by default its axes are the inertial axes. Directions are in its axes.
    axis : (3,)
        Also fit a panel that follows the Sun about this axis (inertial; attitude must be None).
    alarm : float
        Probability of a false glint per light curve.
    longest_s : s
        Duration of the longest glint; by default the time in which the bisector moves by 6°.

    Returns
    -------
    Glints

    Raises
    ------
    InputError
        There is no brightness, no segment has 30 points, or an axis is combined with a spin.
    """
    if axis is not None and attitude is not None and attitude != Fixed():
        raise InputError("a panel that follows the Sun has no spin; give one of axis and attitude")
    observed = Observed.of(curve, attitude or Fixed())
    every = labels(curve)
    rows, flux, error = _averaged(curve, every, observed)
    t, label = curve.t[rows], every[rows]
    sun, obs = observed.sun.mean(axis=0)[rows], observed.obs.mean(axis=0)[rows]
    parts = nights(t, label)
    if not parts:
        raise InputError("no stretch without gaps has 30 points; glints need denser sampling")
    middle = bisector(sun, obs)
    widest = [_time_of(WIDEST, t[part], middle[part]) for part in parts]
    glints, level = detect(
        t, flux, error, label, longest_s or widest, alarm, relative=curve.kind == "mag"
    )
    coarse = [rounding(curve.t[every == label[part[0]]]) for part in parts]
    glints = [replace(one, t_error=max(one.t_error, coarse[one.stretch])) for one in glints]
    seen = []
    for one in glints:
        place, rate = _at(t, middle, parts[one.stretch], one.t)
        seen.append(Sighting(place, rate, one.t_error, one.fwhm))
    reasons, notes = [], []
    if not observed.error_known:
        of = "" if curve.kind == "mag" else "mean "
        notes.append(f"errors are unknown: 2 % of the {of}flux, raised to the scatter, are used")
    shared: list[Direction] = []
    single: list[Direction] = []
    axle = panel = None
    if not glints:
        reasons.append(Finding("no-glint", {"alarm": alarm}))
    elif axis is not None:
        panel = _panel(t, sun, parts, glints, seen, np.asarray(axis, float), reasons)
    else:
        groups = facets(seen, MIN_FIT)
        shared = [g for g in groups if len(g.members) > 1]
        single = [g for g in groups if len(g.members) == 1]
        axle = _cylinder(seen, notes)
        if not shared and axle is None:
            code = "one-glint" if len(glints) == 1 else "no-common-direction"
            reasons.append(Finding(code, {"count": len(glints)}))
    glints = [replace(one, row=int(rows[one.row])) for one in glints]
    return Glints(t, flux, level, glints, seen, shared, single, axle, panel, reasons, notes)


def _averaged(
    curve: LightCurve, label: NDArray[np.integer], observed: Observed
) -> tuple[NDArray[np.integer], Floats, Floats]:
    """First point of each instant, and the flux and error there.

    For magnitudes, the flux is that of the mean magnitude. Magnitudes without errors are assumed to
    have a scatter proportional to the flux.
    """
    flux, error = observed.flux, observed.error
    if curve.kind != "mag":
        return instants(curve.t, label, flux, error)
    relative = error / flux if observed.error_known else np.full(flux.shape, UNKNOWN_ERROR)
    rows, mean, sigma = instants(curve.t, label, np.log(flux), relative)
    return rows, np.exp(mean), sigma * np.exp(mean)


def _time_of(angle: float, t: Floats, vectors: Floats) -> float:
    """Typical time in which a direction moves by an angle; if fixed, a thirtieth of the total."""
    step = np.diff(t)
    moved = np.linalg.norm(np.diff(vectors, axis=0), axis=1)[step > 0] / step[step > 0]
    whole = float(t[-1] - t[0]) / 30.0
    rate = float(np.median(moved)) if moved.size else 0.0
    return angle / rate if rate > 0 else whole


def _at(t: Floats, vectors: Floats, rows: NDArray, when: float) -> tuple[Floats, Floats]:
    """Unit vector and its rate at a given time, from the two adjacent points."""
    times = t[rows]
    i = int(np.clip(np.searchsorted(times, when) - 1, 0, len(times) - 2))
    while i > 0 and times[i + 1] == times[i]:
        i -= 1
    a, b = vectors[rows[i]], vectors[rows[i + 1]]
    step = times[i + 1] - times[i]
    x = (when - times[i]) / step if step > 0 else 0.0
    place = (1 - x) * a + x * b
    place /= np.linalg.norm(place)
    rate = (b - a) / step if step > 0 else np.zeros(3)
    return place, rate - (rate @ place) * place


def _cylinder(seen: list[Sighting], notes: list[str]) -> Direction | None:
    """The axis, excluding the worst-fitting glints, which may be up to one in four."""
    members = list(range(len(seen)))
    if len(members) < 3:
        return None  # an axis perpendicular to two bisectors always exists
    spread = np.linalg.svd(np.array([one.bisector for one in seen]))[1][1]
    if spread < np.sqrt(len(seen) / 2) * np.sin(SPREAD):
        notes.append("no cylinder: the bisectors lie too close together to tell it from a facet")
        return None
    least = max(3, int(np.ceil(0.75 * len(seen))))
    while True:
        fit = cylinder(seen, members)
        if fit is None:
            notes.append("no cylinder: the bisectors lie too close together to fix an axis")
            return None
        if fit.p_value >= MIN_FIT or len(members) == least:
            break
        tries = [[m for m in members if m != out] for out in members]
        fits = [np.inf if (one := cylinder(seen, t)) is None else one.chi2 for t in tries]
        members = tries[int(np.argmin(fits))]
    if fit.p_value < MIN_FIT:
        notes.append(
            f"no cylinder: chi2 of c·b = 0 is {fit.chi2:.1f} for {fit.freedom} degrees of "
            "freedom, the worst quarter of the glints left out"
        )
        return None
    if fit.ellipse[0] > NARROW:
        notes.append("no cylinder: its axis is left open by more than half a radian")
        return None
    return fit


def _panel(
    t: Floats,
    sun: Floats,
    parts: list[NDArray],
    glints: list[Glint],
    seen: list[Sighting],
    axis: Floats,
    reasons: list[Finding],
) -> Tracking | None:
    at = [_at(t, sun, parts[g.stretch], g.t) for g in glints]
    fit = tracking(
        seen,
        np.array([p for p, _ in at]),
        np.array([r for _, r in at]),
        axis / np.linalg.norm(axis),
    )
    if len(glints) < 2:
        reasons.append(Finding("one-glint-no-offset"))
        return None
    if fit.p_value < MIN_FIT:
        values = {"chi2": fit.chi2, "dof": fit.freedom}
        reasons.append(Finding("no-common-offset", values))
        return None
    return fit
