"""What a result rests on: how far each quantity would move under a small fault of the data.

A fault changes the prediction by a column c, in units of the noise. To first order it moves the
parameters by F⁻¹ Jᵀ c, where F contains the priors of zero points, clocks and drift if they are
modelled: the shift is what they do not absorb.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.jax_setup import jnp
from lcbayes.data.lightcurve import LightCurve
from lcbayes.data.observers import observers
from lcbayes.data.segments import PASS, split
from lcbayes.inference.alternatives import LATE_CURVE, alternatives, names_of
from lcbayes.inference.misfit_tests import STEP, Projection
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem, compiled
from lcbayes.modelling.variables import label, reported

Floats = NDArray[np.float64]

CLOCK_S, ZERO_POINT_MAG, DRIFT_PERCENT, NUTATION_DEG = 0.1, 0.03, 1.0, 0.3
CURVE_MIN = 1.0
LATE_CURVE_MIN = "late_curve_1_min"
SITE_KM, ALONG_TRACK_KM = 0.1, 1.0  # elements lose about 1 km along the track in a day
ERROR_FACTOR = 1.4
NUISANCES = (  # meant to move
    "zero_point",
    "series_zero_point",
    "calibration",
    "series_sd",
    "clock_offset",
    "rate_drift",
    "nutation",
)
FAULTS = (
    "shadows",
    "clock_0.1_s",
    "late_pass_0.1_s",
    LATE_CURVE_MIN,
    "zero_point_0.03_mag",
    "rate_drift_1_percent",
    "nutation_0.3_deg",
    "errors_1.4_times",
    "site_100_m",
    "elements_1_day",
)


@dataclass(frozen=True)
class Shifts:
    """Shifts of the quantities of a fit, in standard deviations.

    Attributes
    ----------
    quantities : tuple of str
        Names as in ``summary.json``.
    by_fault : mapping
        For each key of `FAULTS` that applies to the data, the shifts (Q,): the largest over the
        sites, nights, passes and curves that may have the fault, and over the frequencies and
        phases of nutation. For larger errors it is the growth of the sd.
    by_curve : (C, Q)
        Of them, the shifts by late times of each curve; no rows if there is only one.
    """

    quantities: tuple[str, ...]
    by_fault: dict[str, Floats]
    by_curve: Floats


def shifts(
    problem: Problem,
    z: Floats,
    data: Epochs,
    curve: LightCurve,
    sd: Mapping[str, float],
    shadows: Floats | None = None,
) -> Shifts:
    """The shifts at the best fit z (D,).

    Parameters
    ----------
    sd : mapping
        Posterior standard deviation of each quantity, by its name in ``summary.json``.
    shadows : (n, T), optional
        Changes of the flux by shadows that the model leaves out, at n draws. The shift of each
        quantity is its median over them.
    """
    maker = Projection.of(problem, z, data)
    slopes = _slopes(problem, z, data, maker.unit)
    names = tuple(k for k in slopes if sd.get(k, 0.0) > 0 and not k.startswith(NUISANCES))
    gradient = np.array([slopes[name] / sd[name] for name in names]).reshape(len(names), len(z))
    moved = gradient @ maker.covariance @ maker.jacobian.T * maker.power  # (Q, T)
    by_fault: dict[str, Floats] = {}
    by_curve = np.zeros((0, len(names)))
    for fault, columns in _columns(problem, z, data, curve):
        each = np.linalg.norm(moved @ columns.swapaxes(1, 2), axis=2)
        if fault == LATE_CURVE_MIN:
            by_curve = each
        by_fault[fault] = np.maximum(by_fault.get(fault, 0.0), each.max(axis=0, initial=0.0))
    by_fault["errors_1.4_times"] = _growth(gradient, maker)
    if shadows is not None:
        columns = np.asarray(compiled(problem.response)(jnp.asarray(z), data, jnp.asarray(shadows)))
        by_fault["shadows"] = np.median(np.abs(moved @ columns.T), axis=1)
    return Shifts(names, {k: by_fault[k] for k in FAULTS if k in by_fault}, by_curve)


def _slopes(problem: Problem, z: Floats, data: Epochs, unit: Floats) -> dict[str, Floats]:
    """Derivative (D,) of each reported quantity by the parameters, in units of ``unit``."""
    rows = []
    for k in range(len(z)):
        step = np.zeros(len(z))
        step[k] = STEP * unit[k]
        rows.append([_quantities(problem, z + s, data) for s in (step, -step)])
    return {
        name: np.array([_difference(name, up[name], down[name]) for up, down in rows])
        / (2.0 * STEP)
        for name in rows[0][0]
    }


def _difference(name: str, up: float, down: float) -> float:
    period = {"phi": 2.0 * np.pi, "pole_lon_deg": 360.0}.get(name.partition("[")[0])
    return up - down if period is None else (up - down + period / 2) % period - period / 2


def _quantities(problem: Problem, z: Floats, data: Epochs) -> dict[str, float]:
    sites = compiled(problem.constrain)(jnp.asarray(z), data)
    values_by_name = {}
    for name in reported(sites):
        values = np.asarray(sites[name])
        if values.shape[:1] == data.t.shape:
            continue
        for index in np.ndindex(values.shape):
            values_by_name[label(name, index)] = float(values[index])
    return values_by_name


def _growth(gradient: Floats, maker: Projection) -> Floats:
    """Relative growth of the sd (Q,) if all errors are larger."""
    information = maker.power * maker.jacobian.T @ maker.jacobian
    prior = maker.prior_root @ maker.prior_root
    variances = [
        np.einsum(
            "qd,de,qe->q",
            gradient,
            np.linalg.pinv(information / factor**2 + prior, hermitian=True),
            gradient,
        )
        for factor in (1.0, ERROR_FACTOR)
    ]
    return np.sqrt(variances[1] / np.maximum(variances[0], 1e-300)) - 1.0


def _columns(
    problem: Problem, z: Floats, data: Epochs, curve: LightCurve
) -> Iterator[tuple[str, Floats]]:
    """Each fault with the changes (V, K, T) of the prediction over its sd.

    V versions of a fault exclude one another; the K amounts of each are the components of a vector
    of unit length.
    """
    amounts = {
        "zero-point": ("zero_point_0.03_mag", ZERO_POINT_MAG),
        "clock": ("clock_0.1_s", CLOCK_S),
        "late-pass": ("late_pass_0.1_s", CLOCK_S),
        LATE_CURVE: (LATE_CURVE_MIN, CURVE_MIN),
        "rate-drift": ("rate_drift_1_percent", DRIFT_PERCENT),
        "nutation": ("nutation_0.3_deg", NUTATION_DEG),
    }
    for one in alternatives(problem, z, data, names_of(curve), kinds=tuple(amounts)):
        fault, amount = amounts[one.name]
        yield fault, amount * one.columns
    if curve.range_km is not None:
        yield from _places(problem, z, data, curve)


def _places(
    problem: Problem, z: Floats, data: Epochs, curve: LightCurve
) -> Iterator[tuple[str, Floats]]:
    """Displacements of each site along three axes, and of the object along its track."""
    assert curve.range_km is not None
    seen_by = observers(curve)
    to_site = curve.obs * curve.range_km[:, None]
    before = compiled(problem.moments)(jnp.asarray(z), data)

    def change(displacement: Floats) -> Floats:
        moved = to_site + displacement
        distance = np.linalg.norm(moved, axis=1)
        nearer = (np.asarray(curve.range_km) / distance) ** 2
        there = replace(
            data, obs=jnp.asarray(moved / distance[:, None]), dilution=data.dilution * nearer
        )
        after = compiled(problem.moments)(jnp.asarray(z), there)
        return np.asarray((after.mean - before.mean) / before.sd)

    each = [
        change(SITE_KM * np.outer(seen_by.index == k, axis))
        for k in range(len(seen_by.names))
        for axis in np.eye(3)
    ]
    yield "site_100_m", np.array(each)[:, None]
    ahead = change(ALONG_TRACK_KM * _track(curve, to_site, seen_by.index))
    yield "elements_1_day", ahead[None, None]


def _track(curve: LightCurve, to_site: Floats, observer: NDArray[np.int64]) -> Floats:
    """Unit vectors (T, 3) against the direction of flight, zero if it is not known.

    Without a velocity, it is that of the object relative to the site, some 3° from that of flight.
    """
    if curve.velocity_km_s is not None:
        track = -curve.velocity_km_s
    else:
        track = np.zeros_like(to_site)
        for rows in split(curve.t, observer, PASS):
            t, first = np.unique(curve.t[rows], return_index=True)
            if t.size > 1:
                speed = np.gradient(to_site[rows[first]], t, axis=0)
                track[rows] = speed[np.searchsorted(t, curve.t[rows])]
    length = np.linalg.norm(track, axis=1, keepdims=True)
    return np.where(length > 0, track / np.maximum(length, 1e-300), 0.0)
