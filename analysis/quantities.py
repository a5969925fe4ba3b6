"""The numbers in a report: parameters with their diagnostics, and a choice of the main ones."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from lcbayes.analysis.contents import Mode, Results
from lcbayes.geometry.spherical import lon_lat_deg, unwrapped
from lcbayes.modelling.likelihood import PASS_SPREADS
from lcbayes.modelling.variables import is_area, label, named, reported

Floats = NDArray[np.float64]

# name: (description, unit, period of a circular quantity)
KNOWN: dict[str, tuple[str, str, float]] = {
    "albedo_area": ("albedo-area α", "m²", 0.0),
    "phi": ("azimuth φ of the normal", "rad", 2 * np.pi),
    "g": ("cosine g of the polar angle of the normal", "", 0.0),
    "omega": ("angular velocity ω", "rad/s", 0.0),
    "pole_lon_deg": ("pole longitude", "deg", 360.0),
    "pole_lat_deg": ("pole latitude", "deg", 0.0),
    "period_h": ("sidereal period", "h", 0.0),
    "inertia_ratio": ("principal moment of inertia over the largest", "", 0.0),
    "phase0_deg": ("rotational phase at t = 0", "deg", 360.0),
    "phase_a": ("phase law: height a", "", 0.0),
    "phase_d": ("phase law: width d", "rad", 0.0),
    "phase_k": ("phase law: slope k", "1/rad", 0.0),
    "lambert_c": ("weight c of the Lambert term", "", 0.0),
    "sigma": ("noise σ", "", 0.0),
    "noise": ("noise of a curve", "", 0.0),
    "scale": ("scale of a curve", "", 0.0),
    "coefficients": ("coefficient of the log albedo-areas", "", 0.0),
    "r_spec": ("specular reflectance", "", 0.0),
    "r_diff": ("diffuse reflectance", "", 0.0),
    "area": ("area", "", 0.0),
    "member_sd": ("how individuals differ, sd", "mag", 0.0),
    "member_offset": ("how much fainter a curve is than its kind", "mag", 0.0),
    "site_sd": ("how zero points of sites differ, sd", "mag", 0.0),
    "site_offset": ("zero point of a site", "mag", 0.0),
    "pass_sd": ("common offset of a pass, sd", "mag", 0.0),
    "pass_drift_sd": ("drift within a pass, sd", "mag", 0.0),
    "zero_point": ("zero point of a site and night, positive if fainter", "mag", 0.0),
    "calibration_sd": ("how zero points of sites and nights differ, sd", "mag", 0.0),
    "series_zero_point": ("part of the zero point that all nights of a site share", "mag", 0.0),
    "series_sd": ("how the zero points that nights share differ, sd", "mag", 0.0),
    "clock_offset": ("time to add to the clock of an observer", "s", 0.0),
    "rate_drift": ("relative change of rate over the light curve", "", 0.0),
    "correlated_sd": ("correlated noise, sd", "", 0.0),
    "correlated_time_s": ("time scale of the correlated noise", "s", 0.0),
    "extinction": ("extinction", "mag per airmass", 0.0),
    "outlier_share": ("share of outliers", "", 0.0),
    "outlier_width": ("width of outliers, in scales", "", 0.0),
    "nu": ("specular exponent", "", 0.0),
    "roughness": ("relief on the ellipsoid, rms of its harmonics", "", 0.0),
    "size_ratio": ("size of the second ellipsoid over that of the first", "", 0.0),
    "separation": ("distance of the centres over that at contact", "", 0.0),
    "axis_ba": ("axis ratio b/a of an ellipsoid", "", 0.0),
    "axis_cb": ("axis ratio c/b of an ellipsoid", "", 0.0),
    "total_albedo_area": ("albedo-area of the surface", "m²", 0.0),
}
TUMBLING = "inertia_ratio"  # a variable of bodies in torque-free motion alone
# In order of importance; used where only some can be shown.
IMPORTANT = (
    "period_h",
    "pole_lon_deg",
    "pole_lat_deg",
    "omega",
    "albedo_area",
    "phi",
    "g",
    "size_ratio",
    "separation",
    "axis_ba",
    "axis_cb",
    "lambert_c",
    "phase_a",
    "phase_d",
    "phase_k",
    "sigma",
)


def _shown(draws: xr.Dataset) -> list[str]:
    """Variables of interest to a reader, without those that have a value per epoch."""
    return [n for n in reported(list(map(str, draws.data_vars))) if "time" not in draws[n].dims]


@dataclass(frozen=True)
class Quantity:
    """One scalar with its draws (chain, draw), unwrapped if it is circular."""

    name: str
    words: str
    unit: str
    values: Floats

    @property
    def mean(self) -> float:
        return float(np.mean(self.values))

    @property
    def sd(self) -> float:
        return float(np.std(self.values, ddof=1)) if self.values.size > 1 else np.nan

    def quantile(self, q: float) -> float:
        return float(np.quantile(self.values, q))


@dataclass(frozen=True)
class Row:
    """One line of the table of parameters."""

    quantity: Quantity
    mean: float
    sd: float
    quantiles: tuple[float, float, float]  # 5, 50, 95 %
    rhat: float
    ess_bulk: float
    ess_tail: float


def readable(q: Quantity) -> tuple[float, float, str]:
    """Centre to subtract and power of ten to factor out for short axis numbers, and the label.

    A period with a relative error of 10⁻⁶ is drawn as its difference from the mean.
    """
    unit = "" if q.unit == "relative" else q.unit
    spread = q.sd
    if not (np.isfinite(spread) and spread > 0):
        return 0.0, 1.0, f"({unit})" if unit else ""
    largest = max(abs(q.mean), spread)
    if spread < 1e-3 * largest:
        power = int(np.floor(np.log10(spread)))
        centre = round(q.mean, -power)
        sign, shown = ("−", centre) if centre > 0 else ("+", -centre)
        if -2 <= power <= 3:
            return centre, 1.0, f"{sign} {shown:.{max(0, -power)}f} ({unit})".replace(" ()", "")
        return centre, 10.0**power, f"{sign} {shown:.{max(0, -power)}f} (10$^{{{power}}}$ {unit})"
    power = int(np.floor(np.log10(largest)))
    if -2 <= power <= 3:
        return 0.0, 1.0, f"({unit})" if unit else ""
    return 0.0, 10.0**power, f"(10$^{{{power}}}$ {unit})".replace(" )", ")")


def area_unit(results: Results) -> str:
    """m², or empty if the brightness has no absolute scale."""
    return "relative" if results.is_relative else "m²"


def quantities(results: Results, mode: Mode) -> Iterator[Quantity]:
    """Every scalar of a solution, in stored order; arrays by element."""
    for name in _shown(mode.draws):
        words, unit, period = KNOWN.get(name, (name.replace("_", " "), "", 0.0))
        if is_area(name):
            unit = area_unit(results)
        if name in ("sigma", "noise", *PASS_SPREADS):
            unit = "mag" if results.is_magnitude else ""
            words += "" if results.is_magnitude else " ÷ mean flux"
        array = mode.draws[name].transpose("chain", "draw", ...)
        if array.dtype.kind not in "fiub":
            continue
        values = array.to_numpy().astype(float)
        shape = values.shape[2:]
        for index in np.ndindex(*shape):
            one = values[(..., *index)]
            title = named(label(name, index), mode.draws)
            yield Quantity(title, words, unit, unwrapped(one, period) if period else one)


def table(all_of_them: list[Quantity], mode: Mode) -> list[Row]:
    """Rows with R-hat and effective sample sizes, from summary.json or else from ArviZ."""
    if not all_of_them:
        return []
    known = mode.summary.get("parameters") or {}
    if all(q.name in known for q in all_of_them):
        keys = ("rhat", "ess_bulk", "ess_tail")
        rows = [[known[q.name].get(k) for k in keys] for q in all_of_them]
        figures = np.array(rows, dtype=float).T  # null becomes NaN
    else:
        figures = _diagnostics(np.stack([q.values for q in all_of_them]))
    stack = np.stack([q.values for q in all_of_them])
    mean, sd = stack.mean(axis=(1, 2)), stack.std(axis=(1, 2), ddof=1)
    quantiles = np.quantile(stack, (0.05, 0.5, 0.95), axis=(1, 2)).T
    return [
        Row(q, mean[i], sd[i], tuple(quantiles[i]), *figures[:, i])
        for i, q in enumerate(all_of_them)
    ]


def _diagnostics(stack: Floats) -> Floats:
    """R-hat (rank-normalised, split), bulk and tail ESS of draws (Q, chain, draw): (3, Q)."""
    import arviz

    moving = np.ptp(stack, axis=(1, 2)) > 0
    figures = np.full((3, len(stack)), np.nan)
    if moving.any() and stack.shape[2] >= 4:
        axes: dict[str, Any] = {"chain_axis": 1, "draw_axis": 2}
        some = stack[moving]
        if stack.shape[1] > 1:
            figures[0, moving] = arviz.rhat(some, **axes)
        figures[1, moving] = arviz.ess(some, method="bulk", **axes)
        figures[2, moving] = arviz.ess(some, method="tail", prob=(0.05, 0.95), **axes)
    return figures


def important(all_of_them: list[Quantity], most: int = 6) -> list[Quantity]:
    """The most important parameters; if there are many facets, the brightest ones."""
    rank = {name: i for i, name in enumerate(IMPORTANT)}
    all_of_them = [q for q in all_of_them if np.ptp(q.values) > 0]
    known = [q for q in all_of_them if _base(q.name) in rank]
    scalars = [q for q in known if "[" not in q.name]
    arrays = [q for q in known if q not in scalars]
    if len(arrays) > 60:  # a grid of facets: single ones are of little interest
        arrays = []
    areas = sorted((q for q in arrays if q.name.startswith("albedo_area")), key=lambda q: -q.mean)
    rest = [q for q in arrays if q not in areas]
    chosen = sorted(scalars, key=lambda q: rank[_base(q.name)])[:most]
    chosen += [*areas[: max(1, most - 3)], *rest][: most - len(chosen)]
    if not chosen:
        chosen = all_of_them[:most]
    return chosen


def _base(name: str) -> str:
    """The variable to which an element belongs."""
    return "omega" if name.startswith("omega_") else name.split("[")[0]


def axis_names(frame: str) -> tuple[str, str]:
    """Names of the two angles of a direction in a frame."""
    return ("right ascension", "declination") if frame == "icrs" else ("longitude", "latitude")


def constant_axis(draws: xr.Dataset) -> str:
    """The axis of a rotation that is constant in time, of which the pole is the direction."""
    return "angular momentum" if TUMBLING in draws else "spin axis"


def rotation(draws: xr.Dataset, frame: str) -> list[Quantity]:
    """Rate, period and axis of the rotation, in common units; empty without one.

    Rate and axis of a body that tumbles change in time; they are those at the first point.
    """
    if "omega" not in draws:
        return []
    omega = draws["omega"].transpose("chain", "draw", ...).to_numpy()
    rate = np.degrees(np.linalg.norm(omega, axis=-1))
    lon, lat = lon_lat_deg(omega)
    names, first = axis_names(frame), "initial " if TUMBLING in draws else ""
    listed = [Quantity("rate", f"{first}rotation rate", "deg/s", rate)]
    if np.std(rate) < 0.2 * np.mean(rate) and TUMBLING not in draws:
        listed.append(Quantity("turn", "rotation period", "s", 360.0 / rate))
    axis = f"{first}spin axis"
    listed.append(Quantity("axis_lon", f"{axis}, {names[0]}", "deg", unwrapped(lon, 360.0)))
    listed.append(Quantity("axis_lat", f"{axis}, {names[1]}", "deg", lat))
    return listed


def spin(results: Results, mode: Mode) -> list[Quantity]:
    """The spin of the solution, in common units."""
    listed = rotation(mode.draws, results.frame)
    known = ("pole_lon_deg", "pole_lat_deg", "period_h")
    every = [q for q in quantities(results, mode) if q.name in known]
    if TUMBLING in mode.draws:
        axes: dict[str, str] = dict(zip(known, axis_names(results.frame), strict=False))
        axis = constant_axis(mode.draws)
        every = [replace(q, words=f"{axis}, {axes[q.name]}") for q in every]
    return listed + sorted(every, key=lambda q: known.index(q.name))


def facet_normals(mode: Mode) -> Floats | None:
    """Draws of the facet normals, body frame (chain, draw, facet, 3); None on a fixed grid."""
    draws = mode.draws
    if "normals" in draws:
        return draws["normals"].transpose("chain", "draw", "facet", ...).to_numpy()
    if "phi" in draws and "g" in draws:
        phi, g = (draws[k].transpose("chain", "draw", ...).to_numpy() for k in ("phi", "g"))
        s = np.sqrt(np.maximum(1.0 - g**2, 0.0))
        return np.stack([s * np.cos(phi), s * np.sin(phi), g], axis=-1)
    return None


@dataclass(frozen=True)
class Facet:
    """One facet of a solution: its albedo-area and the direction of its normal (body frame)."""

    area: Quantity
    azimuth: float  # deg, of the mean direction; NaN if the pole is within the uncertainty
    polar: float  # deg, of the mean direction
    radius: float  # deg, about the mean direction, containing 90 % of the draws


def facets(results: Results, mode: Mode) -> list[Facet]:
    """The facets of a faceted model, in the order of posterior.nc."""
    normals = facet_normals(mode)
    if normals is None or "albedo_area" not in mode.draws:
        return []
    areas = mode.draws["albedo_area"].transpose("chain", "draw", ...).to_numpy()
    unit = area_unit(results)
    listed = []
    for i in range(areas.shape[-1]):
        u = normals[:, :, i].reshape(-1, 3)
        middle = u.mean(axis=0)
        middle /= max(float(np.linalg.norm(middle)), 1e-300)
        apart = np.arctan2(np.linalg.norm(np.cross(u, middle), axis=1), u @ middle)
        radius = float(np.degrees(np.quantile(apart, 0.9)))
        lon, lat = (float(x) for x in lon_lat_deg(middle))
        azimuth = lon if 90.0 - abs(lat) > radius else np.nan
        area = Quantity(f"facet {i}", "albedo-area", unit, areas[..., i])
        listed.append(Facet(area, azimuth, 90.0 - lat, radius))
    return listed


def key_results(results: Results, mode: Mode) -> list[Quantity]:
    """The rows of the short table at the top: spin, two ellipsoids, surface and noise."""
    rows = spin(results, mode)
    shown = ("size_ratio", "separation", "axis_ba", "axis_cb")
    shown += ("lambert_c", "phase_a", "phase_d", "phase_k", "sigma")
    for q in quantities(results, mode):
        name, _, law = q.name.removesuffix("]").partition("[")
        if name in shown:
            rows.append(replace(q, words=f"{q.words}, {law}") if law else q)
    return rows
