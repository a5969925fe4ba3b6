"""The light curve: times, brightness and viewing geometry, validated at construction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lcbayes.core.constants import DAY_S
from lcbayes.core.errors import InputError, RowError
from lcbayes.geometry.times import date

if TYPE_CHECKING:
    import pandas as pd  # pyright: ignore[reportMissingTypeStubs]
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Floats = NDArray[np.float64]

KINDS = ("flux", "mag")
ORBIT = ("position_km", "velocity_km_s")
FRAMES = ("icrs", "ecliptic-j2000", "inertial")
UNIT_TOLERANCE = 1e-6  # of the length of sun and obs

_MADE: Any = None  # default of the fields that are never None after construction


@dataclass(frozen=True, eq=False, repr=False)
class LightCurve:
    """Brightness of one object as a function of time, with directions to Sun and observer.

    Parameters
    ----------
    t : (T,) s
        Time since ``epoch_jd``, never decreasing within a ``curve``. Equal times are separate
        measurements at the same time, which occur in catalogues with rounded times.
    brightness : (T,)
        Flux or apparent magnitude, depending on ``kind``; all NaN if only the geometry is known.
    error : (T,) or None
        Standard deviation of ``brightness``, in its unit; None if the data have no errors.
    kind : "flux" or "mag"
        ``flux`` is in W/m² (visible band) if ``range_km`` is given, otherwise reduced to unit
        distances and unit solar irradiance. ``mag`` is an apparent magnitude in ``band``.
    sun, obs : (T, 3)
        Unit vectors from the object to the Sun and to the observer, axes of ``frame``; all NaN if
        only the brightness is known, which is sufficient for `lcbayes.look` alone.
    range_km : (T,) or None
        Distance between object and observer.
    position_km, velocity_km_s : (T, 3) or None
        Geocentric position and velocity of the object in the same axes (``frame`` "icrs"), required
        by attitude laws; None if no orbit is known.
    curve : (T,) int
        Index of the group to which a point belongs, 0 .. n_curves-1.
    free_scale : (n_curves,) bool
        Whether the brightness of that group has an unknown factor (relative photometry). By
        default only magnitudes without ``range_km`` have one.
    curve_names : n_curves strings
        Name of each group, all different.
    band, site : (T,) str
        Empty strings if unknown.
    exposure_s : (T,) s
        0 if unknown.
    epoch_jd : float or None
        Julian date (UTC; for DAMIT files light-time corrected) of t = 0; None if only seconds are
        known.
    frame : "icrs", "ecliptic-j2000" or "inertial"
        Axes of ``sun`` and ``obs``; "inertial" if the file does not name them.
    extra : mapping
        Other columns of the file, (T,) each, not used here and kept unchanged.
    source : mapping
        Origin of the curve: ``file``, ``format``, ``sha256``, ``tle_sha256``; ``reading`` contains
        the options it was read with (JSON), and ``notes`` what the reader left out or assumed.

    Raises
    ------
    InputError
        A one-line message that names the invalid value and the remedy.
    """

    t: Floats
    brightness: Floats
    error: Floats | None
    sun: Floats
    obs: Floats
    kind: str = "flux"
    range_km: Floats | None = None
    position_km: Floats | None = None
    velocity_km_s: Floats | None = None
    curve: NDArray[np.int64] = _MADE  # all zero by default
    free_scale: NDArray[np.bool_] = _MADE
    curve_names: tuple[str, ...] = ()  # numbered from 0 by default
    band: NDArray[np.str_] = _MADE
    site: NDArray[np.str_] = _MADE
    exposure_s: Floats = _MADE
    epoch_jd: float | None = None
    frame: str = "inertial"
    extra: Mapping[str, Any] = field(default_factory=dict[str, Any])
    source: Mapping[str, str] = field(default_factory=dict[str, str])

    def __post_init__(self) -> None:
        self._complete()
        self._check_points()
        self._check_curves()

    def _complete(self) -> None:
        """Convert every field to its type and shape."""

        def put(name: str, value: Any) -> None:
            object.__setattr__(self, name, value)

        given = dict(vars(self))  # here a field may still be None
        _one_of("kind", self.kind, KINDS)
        _one_of("frame", self.frame, FRAMES)
        t = _floats("t", self.t)
        if t.ndim != 1 or t.size == 0:
            raise InputError(f"t has shape {t.shape}; expected (T,) with at least one point")
        n = t.size
        put("t", t)
        for name, shape in _SHAPES.items():
            value = getattr(self, name)
            if value is not None:
                value = _floats(name, value)
                _same_shape(name, value, (n, *shape))
                put(name, value)
        if given["exposure_s"] is None:
            put("exposure_s", np.zeros(n))
        for name in ("band", "site"):
            value = getattr(self, name)
            value = np.full(n, "") if value is None else np.asarray(value, dtype=np.str_)
            _same_shape(name, value, (n,))
            put(name, value)
        put("curve", np.zeros(n, np.int64) if given["curve"] is None else _indices(self.curve, n))
        n_curves = int(np.max(self.curve)) + 1
        relative = self.kind == "mag" and self.range_km is None
        free = np.full(n_curves, relative) if given["free_scale"] is None else self.free_scale
        put("free_scale", np.asarray(free, dtype=bool))
        _same_shape("free_scale", self.free_scale, (n_curves,), per="curve")
        names = tuple(str(name) for name in self.curve_names) or tuple(map(str, range(n_curves)))
        put("curve_names", names)
        put("extra", {str(k): np.asarray(v) for k, v in self.extra.items()})
        for name, value in self.extra.items():
            if value.shape[:1] != (n,):
                raise InputError(
                    f"extra column {name!r} has shape {value.shape}; expected {n} rows"
                )
        put("source", dict(self.source))

    def _check_points(self) -> None:
        """Check that all numbers used by the physics are valid."""
        for name in ("t", "error", "range_km", "exposure_s", *ORBIT):
            _reject(name, getattr(self, name), ~_finite(getattr(self, name)), "not finite", _DROP)
        if self.position_km is not None and self.frame != "icrs":
            raise InputError(
                f"an orbit is given for directions in {self.frame!r} axes; both must be in icrs"
            )
        if self.velocity_km_s is not None and self.position_km is None:
            raise InputError("velocity_km_s is given without position_km; give both")
        if not self.geometry_only:
            bad = ~np.isfinite(self.brightness)
            _reject("brightness", self.brightness, bad, "not finite", _DROP)
        _reject("error", self.error, _below(self.error, 0, equal=True), "<= 0", _GIVE_ERRORS)
        _reject("range_km", self.range_km, _below(self.range_km, 0, equal=True), "<= 0", _RANGES)
        _reject("exposure_s", self.exposure_s, _below(self.exposure_s, 0), "< 0", _EXPOSURES)
        for name in ("sun", "obs"):
            vectors: Floats = getattr(self, name)
            if self.brightness_only:
                continue
            length: Floats = np.linalg.norm(vectors, axis=1)
            bad = ~(np.abs(length - 1.0) <= UNIT_TOLERANCE)
            _reject(name, vectors, bad, "not of length 1", _UNIT)
        if self.epoch_jd is not None:
            object.__setattr__(self, "epoch_jd", float(self.epoch_jd))
            if not np.isfinite(self.epoch_jd):
                raise InputError(f"epoch_jd is {self.epoch_jd}; expected a Julian date or None")

    def _check_curves(self) -> None:
        """Check that groups are 0 .. n_curves-1 with unique names and non-decreasing times."""
        n_curves = len(self.free_scale)
        points = np.bincount(self.curve, minlength=n_curves)
        if not points.all():
            raise InputError(
                f"curve {int(np.argmin(points))} has no points; number the curves "
                f"0 .. {n_curves - 1} without gaps"
            )
        if len(self.curve_names) != n_curves or len(set(self.curve_names)) != n_curves:
            raise InputError(
                f"curve_names has {len(set(self.curve_names))} different names for {n_curves} "
                "curves; give each curve one name of its own"
            )
        if self.kind == "mag" and self.range_km is None and not np.all(self.free_scale):
            raise InputError(
                "free_scale is False for magnitudes without range_km, which say nothing of the "
                "body's size; give range_km, or make it True"
            )
        order = np.argsort(self.curve, kind="stable")
        before, after = order[:-1], order[1:]
        back = np.zeros(self.t.size, bool)
        back[after] = (self.curve[before] == self.curve[after]) & (self.t[after] < self.t[before])
        _reject("t", self.t, back, "earlier than the point before", _SORT)

    @property
    def n_obs(self) -> int:
        """Number of points."""
        return self.t.size

    @property
    def n_curves(self) -> int:
        """Number of groups."""
        return len(self.curve_names)

    @property
    def curve_titles(self) -> tuple[str, ...]:
        """Each group as pages and messages name it; unnamed groups are numbered from 1."""
        return curve_titles(self.curve_names)

    @property
    def dated_titles(self) -> tuple[str, ...]:
        """Titles of the groups with the date of their first point, if the epoch is known."""
        if self.epoch_jd is None:
            return self.curve_titles
        first = [self.t[self.curve == k].min() for k in range(self.n_curves)]
        days = [date(self.epoch_jd + float(t) / DAY_S) for t in first]
        return tuple(f"{x} ({day})" for x, day in zip(self.curve_titles, days, strict=True))

    @property
    def geometry_only(self) -> bool:
        """Whether the brightness is unknown throughout, i.e. the epochs are for prediction."""
        return bool(np.isnan(self.brightness).all())

    @property
    def brightness_only(self) -> bool:
        """Whether the directions to Sun and observer are unknown throughout."""
        return bool(np.isnan(self.sun).all() and np.isnan(self.obs).all())

    @property
    def phase_angle(self) -> Floats:
        """Angle Sun-object-observer, rad, (T,); NaN if the directions are unknown."""
        cross = np.linalg.norm(np.cross(self.sun, self.obs), axis=1)
        return np.arctan2(cross, np.sum(self.sun * self.obs, axis=1))

    def __len__(self) -> int:
        return self.n_obs

    def to_pandas(self) -> pd.DataFrame:
        """One row per point with the columns of a CSV file; ``attrs`` holds epoch and frame.

        `lcbayes.read` restores the light curve from it.
        """
        import pandas as pd  # pyright: ignore[reportMissingTypeStubs]

        from lcbayes.data.formats.written import columns_of, meta_of

        table = pd.DataFrame(columns_of(self))
        table.attrs.update(meta_of(self))
        return table

    def plot(self, ax: Axes | None = None) -> Figure:
        """Brightness against time, one colour per site and band.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            Axes to draw on; by default those of a new figure.

        Returns
        -------
        matplotlib Figure
        """
        from lcbayes.data.plot import plot

        return plot(self, ax)

    def select(self, mask: ArrayLike) -> LightCurve:
        """The points selected by a boolean mask or by indices, in that order.

        Empty curves are removed.
        """
        index = np.arange(self.n_obs)[np.asarray(mask)]
        if index.size == 0:
            raise InputError("the selection holds no points; choose at least one")
        kept, curve = np.unique(self.curve[index], return_inverse=True)
        per_point = {
            name: getattr(self, name)[index]
            for name in ("t", "brightness", "sun", "obs", "band", "site", "exposure_s")
        }
        return replace(
            self,
            **per_point,
            **{
                name: None if (values := getattr(self, name)) is None else values[index]
                for name in _OPTIONAL
            },
            curve=curve,
            free_scale=self.free_scale[kept],
            curve_names=tuple(self.curve_names[int(i)] for i in kept),
            extra={name: value[index] for name, value in self.extra.items()},
        )

    def __repr__(self) -> str:
        span = float(np.ptp(self.t))
        shown = f"{span:.6g} s" if span < 2 * 86400 else f"{span / 86400:.6g} d"
        scales = int(np.sum(self.free_scale))
        return (
            f"LightCurve({self.n_obs} points, {self.n_curves} curves ({scales} of unknown scale), "
            f"{self.kind}, errors {'unknown' if self.error is None else 'given'}, "
            f"ranges {'unknown' if self.range_km is None else 'given'}, {shown}, {self.frame})"
        )


_SHAPES = {"brightness": (), "error": (), "sun": (3,), "obs": (3,), "range_km": ()} | {
    "position_km": (3,),
    "velocity_km_s": (3,),
    "exposure_s": (),
}
_OPTIONAL = ("error", "range_km", *ORBIT)
_DROP = "drop those rows"
_GIVE_ERRORS = "give positive errors, drop those rows, or set a floor with --error-floor"
_RANGES = "give distances in km, greater than 0"
_EXPOSURES = "give exposure times in seconds, 0 where unknown"
_UNIT = "divide each by its length"
_SORT = "sort the rows of each curve by time"


def curve_titles(names: Sequence[str]) -> tuple[str, ...]:
    """Titles of groups from their names, which are numbers from 0 if the file has none."""
    unnamed = tuple(names) == tuple(map(str, range(len(names))))
    return tuple(f"curve {k + 1 if unnamed else name}" for k, name in enumerate(names))


def _one_of(name: str, value: object, allowed: tuple[str, ...]) -> None:
    if value not in allowed:
        raise InputError(f"{name} is {value!r}; expected one of: {', '.join(allowed)}")


def _floats(name: str, value: ArrayLike) -> Floats:
    try:
        return np.asarray(value, dtype=float)
    except (TypeError, ValueError) as fault:
        raise InputError(f"{name} is not an array of numbers ({fault}); give floats") from None


def _indices(value: ArrayLike, n: int) -> NDArray[np.int64]:
    index = np.asarray(value)
    _same_shape("curve", index, (n,))
    if not np.issubdtype(index.dtype, np.integer):
        raise InputError(f"curve has type {index.dtype}; expected integers 0 .. n_curves-1")
    _reject("curve", index, index < 0, "< 0", "number the curves from 0")
    _reject("curve", index, index >= n, ">= the number of points", "number the curves from 0")
    return index.astype(np.int64)


def _same_shape(name: str, value: Any, shape: tuple[int, ...], per: str = "time") -> None:
    if value.shape != shape:
        raise InputError(f"{name} has shape {value.shape}; expected {shape}: one per {per}")


def _finite(value: Floats | None) -> NDArray[np.bool_]:
    if value is None:
        return np.ones(0, bool)
    return np.isfinite(value).reshape(len(value), -1).all(axis=1)


def _below(value: Floats | None, limit: float, equal: bool = False) -> NDArray[np.bool_]:
    if value is None:
        return np.zeros(0, bool)
    return value <= limit if equal else value < limit


def _reject(name: str, value: Any, bad: NDArray[np.bool_], what: str, remedy: str) -> None:
    """Raise `RowError` for the points where `bad` holds."""
    count = int(np.count_nonzero(bad))
    if count:
        row = int(np.argmax(bad))
        noun = "value" if count == 1 else "values"
        raise RowError(name, f"has {count} {noun} {what}", row, value[row], remedy)
