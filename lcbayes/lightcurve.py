"""The light curve: times, brightness and the geometry it was seen under, validated when made."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcbayes.errors import InputError

Floats = NDArray[np.float64]

FRAMES = ("icrs", "ecliptic-j2000", "inertial")


@dataclass(frozen=True)
class LightCurve:
    """Brightness of one object against time, with the directions to Sun and observer.

    Parameters
    ----------
    t : (T,) s
        Time since ``epoch_jd``, strictly increasing within each ``curve``.
    brightness : (T,)
        Flux or apparent magnitude, as ``kind`` says.
    error : (T,) or None
        Standard deviation of ``brightness``, in its unit; None when the data carry no errors.
    kind : "flux" or "mag"
        ``flux`` is in W/m² (visible band) when ``range_km`` is given, otherwise reduced to unit
        distances and unit solar irradiance. ``mag`` is an apparent magnitude in ``band``.
    sun, obs : (T, 3)
        Unit vectors from the object to the Sun and to the observer, axes of ``frame``.
    range_km : (T,) or None
        Distance between object and observer.
    curve : (T,) int
        Index of the group a point belongs to, 0 .. n_curves-1.
    free_scale : (n_curves,) bool
        Whether the brightness of that group carries an unknown factor (relative photometry).
    band, site : (T,) str
        Empty strings where the data do not say.
    exposure_s : (T,) s
        0 where the data do not say.
    epoch_jd : float or None
        Julian date (UTC; for DAMIT files light-time corrected) of t = 0; None when only seconds
        are known.
    frame : "icrs", "ecliptic-j2000" or "inertial"
        Axes of ``sun`` and ``obs``; "inertial" when the file does not name them.
    extra : mapping
        Columns of the file that have no meaning here, kept as they are.
    source : mapping
        Where the curve came from: ``file``, ``format``, ``sha256``.

    Raises
    ------
    InputError
        One line that says which value is at fault and what to do.
    """

    t: Floats
    brightness: Floats
    error: Floats | None
    sun: Floats
    obs: Floats
    kind: str = "flux"
    range_km: Floats | None = None
    curve: NDArray[np.int64] | None = None  # made all-zero when absent
    free_scale: NDArray[np.bool_] | None = None  # made all-False when absent
    curve_names: tuple[str, ...] = ()
    band: NDArray[np.str_] | None = None
    site: NDArray[np.str_] | None = None
    exposure_s: Floats | None = None
    epoch_jd: float | None = None
    frame: str = "inertial"
    extra: Mapping[str, Any] = field(default_factory=dict)
    source: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        n = np.asarray(self.t).size
        put = object.__setattr__
        for name in ("t", "brightness", "error", "sun", "obs", "range_km", "exposure_s"):
            value = getattr(self, name)
            if value is not None:
                put(self, name, np.asarray(value, dtype=float))
        put(self, "curve", np.zeros(n, int) if self.curve is None else np.asarray(self.curve, int))
        n_curves = int(self.curve.max()) + 1 if n else 0  # pyright: ignore
        if self.free_scale is None:
            put(self, "free_scale", np.zeros(n_curves, bool))
        else:
            put(self, "free_scale", np.asarray(self.free_scale, bool))
        if not self.curve_names:
            put(self, "curve_names", tuple(str(i) for i in range(n_curves)))
        for name in ("band", "site"):
            if getattr(self, name) is None:
                put(self, name, np.full(n, ""))
        if self.exposure_s is None:
            put(self, "exposure_s", np.zeros(n))
        if self.kind not in ("flux", "mag"):
            raise InputError(f"kind is {self.kind!r}; expected 'flux' or 'mag'")

    @property
    def n_obs(self) -> int:
        return self.t.size

    @property
    def n_curves(self) -> int:
        return len(self.curve_names)

    @property
    def phase_angle(self) -> Floats:
        """Angle Sun-object-observer, rad, (T,)."""
        cross = np.linalg.norm(np.cross(self.sun, self.obs), axis=1)
        return np.arctan2(cross, np.sum(self.sun * self.obs, axis=1))
