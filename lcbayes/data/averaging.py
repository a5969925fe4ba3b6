"""Averages of consecutive points, for photometry faster than the motion needs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.errors import InputError
from lcbayes.data.lightcurve import LightCurve
from lcbayes.data.segments import Gap, Rows, labels, split

Floats = NDArray[np.float64]

AUTO = "auto"
MAX_BIAS = 0.5  # of an average, in units of its random error, rms over the curve
LONGEST = 100  # points in an average
RUN = Gap(0.0, 2.5)  # steps within which points are consecutive
MAGNITUDE = 2.5 / np.log(10.0)  # mag per relative flux
UNWEIGHTED = ("t", "sun", "obs", "exposure_s", "range_km", "position_km", "velocity_km_s")


def averaged(curve: LightCurve, window: str) -> LightCurve:
    """A light curve whose points are averages of n consecutive ones.

    With ``"auto"``, n is the largest number for which averaging is harmless: for n and all smaller
    numbers, the error b of an average from the change of brightness within it is at most half of
    its random error s/√n, rms over the curve. The noise s of a point follows from second
    differences of the brightness, so that changes from point to point that are as irregular as
    noise count as noise. Two estimates of b must agree with the rule. Both hold for a brightness
    c x², with x in points, of which b = c (n² − 1)/12:

    - within averages, the variance about the straight line through the n points exceeds s² by
      c² n (n² − 1)(n + 2)/180;
    - between averages, their second differences are 2 c n², beside the noise.

    The first is sensitive to glints shorter than an average. Its own uncertainty, some 2 s²/√T for
    T points, makes n smaller than it need be where the brightness changes slowly.

    Fluxes are averaged, not magnitudes. Errors of the file are propagated; if there are none, the
    errors are s/√n, where s is relative to the flux if the curve is in magnitudes.

    Parameters
    ----------
    curve : LightCurve
    window : "auto" or a time in s
        Points of one curve, site and band without a gap of more than 2.5 median steps are averaged.
        Fewer than n points at the end of such a run are averaged as well.

    Returns
    -------
    LightCurve
        ``source["notes"]`` says how many points were averaged and why.

    Raises
    ------
    InputError
        The window is neither "auto" nor a time, or shorter than two steps.

    Examples
    --------
    >>> import numpy as np
    >>> from lcbayes import LightCurve
    >>> t = 0.1 * np.arange(3000)
    >>> noise = 0.2 * np.random.default_rng(0).standard_normal(3000)
    >>> curve = LightCurve(t=t, brightness=np.sin(0.3 * t) + 3.0 + noise, error=None,
    ...     sun=np.tile([1.0, 0.0, 0.0], (3000, 1)), obs=np.tile([0.0, 1.0, 0.0], (3000, 1)))
    >>> averaged(curve, "0.5").n_obs
    600
    """
    runs = split(curve.t, labels(curve), RUN)
    flux = curve.brightness
    if curve.kind == "mag":
        flux = 10.0 ** (-0.4 * (curve.brightness - np.nanmedian(curve.brightness)))
    steps = np.concatenate([np.diff(curve.t[rows]) for rows in runs])
    step = float(np.median(steps[steps > 0.0])) if np.any(steps > 0.0) else np.inf
    harmless = _harmless(flux, runs)
    n = harmless if window == AUTO else _number(window, step)
    noise = noise_of(flux, runs, relative=curve.kind == "mag")
    if n < 2:
        return _noted(curve, "points were not averaged: the brightness changes within two of them")
    groups = [g for rows in runs for g in np.split(rows, np.arange(n, rows.size, n)) if g.size]
    groups.sort(key=lambda g: (curve.t[g[0]], curve.curve[g[0]]))
    why = f"in groups of {n} ({n * step:.3g} s)"
    if window == AUTO:
        why += (
            f", the largest for which the error of an average from the change of brightness within "
            f"it is at most {MAX_BIAS:g} of its random error"
        )
    said = f"{curve.n_obs} points were averaged {why}: {len(groups)} points"
    if n > harmless:
        said += (
            "; the brightness changes within them by more than half of their random error, which "
            "no model takes into account: give --average auto, or leave it out"
        )
    if curve.error is None:
        unit = " mag" if curve.kind == "mag" else ""
        said += (
            f"; their errors follow from the scatter of the points, {noise:.3g}{unit} for each "
            "about a smooth curve"
        )
    return _noted(_grouped(curve, flux, groups, noise), said)


def noise_of(flux: Floats, runs: Sequence[Rows], relative: bool = False) -> float:
    """Standard deviation of a point, from second differences of consecutive ones.

    Parameters
    ----------
    flux : (T,)
    runs : rows of consecutive points
    relative : bool
        Whether the noise is a fraction of the flux, the mean of the three points.

    Returns
    -------
    float
        In the unit of the flux, or in magnitudes if relative. NaN if no three points are
        consecutive.
    """
    values = [flux[rows] for rows in runs if rows.size > 2]
    if not values:
        return np.nan
    second = np.concatenate([np.diff(y, 2) for y in values])
    if relative:
        three = [np.convolve(y, np.full(3, 1.0 / 3.0), "valid") for y in values]
        second *= MAGNITUDE / np.concatenate(three)
    return float(np.sqrt(np.mean(second**2) / 6.0))


def _harmless(flux: Floats, runs: Sequence[Rows]) -> int:
    """The largest number of points whose average obeys the rule of `averaged`."""
    variance = noise_of(flux, runs) ** 2
    for n in range(2, LONGEST + 1):
        near = max(n, 4)  # through three points, second differences and residuals are the same
        inside, between = _blocks(flux, runs, near), _blocks(flux, runs, n).mean(axis=2)
        if not inside.size or not between.size:
            return n - 1
        inside = inside.reshape(-1, near)
        x = np.arange(near) - 0.5 * (near - 1)
        off = inside - inside.mean(axis=1, keepdims=True)
        off -= np.outer(off @ x / (x @ x), x)
        excess = max(np.sum(off**2) / (len(off) * (near - 2)) - variance, 0.0)
        # Second differences of c x² are 2 c, by which the noise is too large.
        square = excess / (near * (near**2 - 1) * (near + 2) / 180.0 - 2.0 / 3.0)
        slow = np.mean(np.diff(between, 2, axis=1) ** 2) - 6.0 * variance / n
        square = max(square, slow / (2.0 * n**2) ** 2)
        noise = variance - 2.0 / 3.0 * square
        if square * ((n * n - 1) / 12.0) ** 2 > MAX_BIAS**2 * noise / n:
            return n - 1
    return LONGEST


def _blocks(flux: Floats, runs: Sequence[Rows], n: int) -> Floats:
    """Flux of three consecutive groups of n consecutive points, (m, 3, n)."""
    groups = [rows[: rows.size // (3 * n) * 3 * n].reshape(-1, 3, n) for rows in runs]
    return flux[np.concatenate(groups)]


def _number(window: str, step: float) -> int:
    """Number of points in a window given in s."""
    try:
        seconds = float(window)
    except ValueError:
        seconds = np.nan
    if not (np.isfinite(seconds) and seconds > 0.0):
        raise InputError(
            f"--average is {window!r}; expected auto, or a time in seconds such as 0.5"
        )
    n = round(seconds / step)
    if n < 2:
        raise InputError(
            f"--average is {window} s, and the points are {step:.3g} s apart; give a longer time, "
            "or leave the option out"
        )
    return n


def _grouped(curve: LightCurve, flux: Floats, groups: Sequence[Rows], noise: float) -> LightCurve:
    """The light curve with one point for each group of rows."""
    first = np.array([g[0] for g in groups])
    label = np.empty(curve.n_obs, int)
    for i, rows in enumerate(groups):
        label[rows] = i
    number = np.bincount(label)

    def mean(values: Floats) -> Floats:
        if values.ndim == 2:
            return np.stack([mean(column) for column in values.T], axis=1)
        return np.bincount(label, values) / number

    fields: dict[str, Any] = {
        name: mean(values) for name in UNWEIGHTED if (values := getattr(curve, name)) is not None
    }
    for name in ("sun", "obs"):
        fields[name] = fields[name] / np.linalg.norm(fields[name], axis=1, keepdims=True)
    total = mean(flux)
    if curve.error is None:
        error = noise / np.sqrt(number)
    elif curve.kind == "mag":
        error = np.sqrt(mean((curve.error * flux) ** 2) / number) / total
    else:
        error = np.sqrt(mean(curve.error**2) / number)
    if curve.kind == "mag":
        total = np.nanmedian(curve.brightness) - MAGNITUDE * np.log(total)
    return replace(
        curve,
        **fields,
        brightness=total,
        error=error,
        curve=curve.curve[first],
        band=curve.band[first],
        site=curve.site[first],
        extra={},
    )


def _noted(curve: LightCurve, note: str) -> LightCurve:
    notes = "; ".join(filter(None, (curve.source.get("notes", ""), note)))
    return replace(curve, source={**curve.source, "notes": notes})
