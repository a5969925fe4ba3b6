"""Figures 3 to 7 of Wang et al. 2025: observability of attitude over the observer's hemisphere.

One facet of 1 m² with R_s = R_d = 0.5 and r = 1000 has its normal upwards and the Sun at azimuth 0.
The observability is |∂E/∂δα| of the irradiance at unit distance under unit irradiance. Figures 3 to
6: the diffuse part with the Sun at elevations of 5, 30, 48 and 90 deg; figure 7: the specular part
at 55 deg. Below: the best elevation of the observer for every elevation of the Sun. The paper's
figure 5 has the peak at 48 deg; over both elevations it is at (41, 56) deg and at the mirrored
pair.
"""

from __future__ import annotations

from typing import Any

import _script
import numpy as np
from hinks import LAW, write_table
from numpy.typing import NDArray
from scipy.optimize import minimize, minimize_scalar

from lcbayes.analysis import style
from lcbayes.core.jax_setup import jnp
from lcbayes.physics.sensitivity import closed_form

Floats = NDArray[np.float64]
R_S, R_D, R = 0.5, 0.5, 1000.0
NORMAL = jnp.array([[0.0, 0.0, 1.0]])
SUNS, SPECULAR_SUN = (5.0, 30.0, 48.0, 90.0), 55.0


def direction(elevation_deg: Floats | float, azimuth_deg: Floats | float = 0.0) -> Floats:
    """Unit vectors from elevation above the facet and azimuth relative to the Sun."""
    e, a = np.broadcast_arrays(np.radians(elevation_deg), np.radians(azimuth_deg))
    return np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=-1)


def observability(sun: Floats, obs: Floats, part: str) -> Floats:
    """|∂E/∂δα| (1/rad) of the diffuse or the specular part, for directions (..., 3).

    The diffuse part has the factor (1 − R_s) of (6) and no lobe; the specular part has R_d = 0.
    """
    sun, obs = np.broadcast_arrays(sun, obs)
    s, o = jnp.asarray(sun.reshape(-1, 3)), jnp.asarray(obs.reshape(-1, 3))

    def slope(r_diff: float) -> Floats:
        p = {"r_spec": R_S, "r_diff": r_diff, "nu": R}
        return np.asarray(closed_form(s, o, NORMAL, jnp.ones(1), LAW, p).attitude)

    gradient = slope(0.0) if part == "specular" else slope(R_D) - slope(0.0)
    return np.linalg.norm(gradient, axis=-1).reshape(sun.shape[:-1])


def in_plane(sun_deg: float, obs_deg: float) -> float:
    """Diffuse observability, with the observer on the Sun's side of the facet's normal."""
    return float(observability(direction(sun_deg), direction(obs_deg), "diffuse"))


def best_observer(sun_deg: float) -> tuple[float, float]:
    """Elevation of the observer (deg) with the largest diffuse observability, and its value."""
    optimum: Any = minimize_scalar(
        lambda e: -in_plane(sun_deg, float(e)),
        bounds=(1.0, 90.0),
        method="bounded",
        options={"xatol": 1e-4},
    )
    return float(optimum.x), float(-optimum.fun)


def best_pair(start: tuple[float, float]) -> tuple[Floats, float]:
    """Elevations (deg) of Sun and observer with the largest diffuse observability, and its
    value."""
    optimum: Any = minimize(
        lambda e: -in_plane(*e),
        start,
        method="Nelder-Mead",
        options={"xatol": 1e-4, "fatol": 1e-12},
    )
    return optimum.x, float(-optimum.fun)


def ring() -> dict[str, float]:
    """The ring of the specular part: its centre, the position of its peak, and its width (deg)."""
    sun = direction(SPECULAR_SUN)

    def value(e: Floats) -> float:
        return float(observability(sun, direction(e[0], e[1]), "specular"))

    optimum: Any = minimize(
        lambda e: -value(e),
        (SPECULAR_SUN + 3.0, 180.0),
        method="Nelder-Mead",
        options={"xatol": 1e-5, "fatol": 1e-12},
    )
    span = SPECULAR_SUN - 8.0, SPECULAR_SUN - 0.5
    below: Any = minimize_scalar(
        lambda e: -value(np.array([e, 180.0])), bounds=span, method="bounded"
    )
    return {
        "elevation": float(optimum.x[0]),
        "azimuth": float(optimum.x[1]),
        "value": float(-optimum.fun),
        "below": float(below.x),
        "value below": float(-below.fun),
    }


def numbers() -> list[tuple[str, str]]:
    rows = []
    for sun, fig in zip(SUNS, (3, 4, 5, 6), strict=True):
        obs, value = best_observer(sun)
        azimuths = np.arange(0.0, 360.0, 5.0)
        elevations = np.arange(1.0, 90.1, 1.0)
        a, e = np.meshgrid(azimuths, elevations)
        everywhere = observability(direction(sun), direction(e, a), "diffuse").max()
        where = "any azimuth" if sun == 90.0 else "azimuth 0"
        rows.append(
            (
                f"fig. {fig}: Sun {sun:g} deg high, best observer",
                f"{obs:.1f} deg high, {where}; {value:.5f} /rad "
                f"(largest on a grid over the hemisphere {everywhere:.5f})",
            )
        )
    for start in ((35.0, 60.0), (60.0, 35.0)):
        pair, top = best_pair(start)
        rows.append(
            (
                "diffuse, best of both, Sun and observer",
                f"{pair[0]:.1f} and {pair[1]:.1f} deg high; {top:.5f} /rad",
            )
        )
    even = in_plane(48.0, 48.0)
    rows.append(("diffuse, both 48 deg high", f"{100.0 * (1.0 - even / top):.3f} % below that"))
    brightest = ring()
    rows += [
        (
            f"fig. 7: specular, Sun {SPECULAR_SUN:g} deg high, best observer",
            f"{brightest['elevation']:.2f} deg high, azimuth {brightest['azimuth']:.1f} deg; "
            f"{brightest['value']:.1f} /rad",
        ),
        (
            "fig. 7: lowest point of the ring",
            f"{brightest['below']:.2f} deg high; {brightest['value below']:.1f} /rad",
        ),
        (
            "fig. 7 over fig. 5, largest of each",
            f"{brightest['value'] / best_observer(48.0)[1]:.0f} times",
        ),
    ]
    return rows


def main() -> None:
    args = _script.parser(__doc__ or "").parse_args()
    write_table(numbers(), args.out, "wang")
    figure = _script.figure(13.0, 7.0)
    grid = figure.add_gridspec(2, 10, height_ratios=(1.1, 1.0))
    top = max(best_observer(sun)[1] for sun in SUNS)
    azimuth, zenith = np.radians(np.linspace(0.0, 360.0, 181)), np.linspace(0.0, 89.0, 90)
    a, z = np.meshgrid(azimuth, zenith)
    for k, sun in enumerate(SUNS):
        axes = figure.add_subplot(grid[0, 2 * k : 2 * k + 2], projection="polar")
        seen = observability(direction(sun), direction(90.0 - z, np.degrees(a)), "diffuse")
        picture = axes.pcolormesh(azimuth, zenith, seen, vmin=0.0, vmax=top, rasterized=True)
        _dress(axes, f"fig. {3 + k}: Sun {sun:g}°")
        axes.plot(0.0, 90.0 - sun, "*", ms=11, color="#ffd23f", mec=style.INK, mew=0.5)
        axes.plot(0.0, 90.0 - best_observer(sun)[0], "o", ms=7, mfc="none", mec="white", mew=1.5)
    figure.colorbar(
        picture,
        ax=figure.axes,
        location="right",
        shrink=0.7,
        pad=0.01,
        label="diffuse |∂E/∂δα| (1/rad)",
    )
    axes = figure.add_subplot(grid[0, 8:], projection="polar")
    seen = observability(direction(SPECULAR_SUN), direction(90.0 - z, np.degrees(a)), "specular")
    fine_a, fine_z = np.radians(np.linspace(168.0, 192.0, 121)), np.linspace(25.0, 45.0, 101)
    fa, fz = np.meshgrid(fine_a, fine_z)
    fine = observability(direction(SPECULAR_SUN), direction(90.0 - fz, np.degrees(fa)), "specular")
    axes.pcolormesh(azimuth, zenith, seen, rasterized=True)
    _dress(axes, f"fig. 7: specular, Sun {SPECULAR_SUN:g}°")
    axes.plot(0.0, 90.0 - SPECULAR_SUN, "*", ms=11, color="#ffd23f", mec=style.INK, mew=0.5)
    closer = figure.add_subplot(grid[1, 6:])
    picture = closer.pcolormesh(np.degrees(fine_a), 90.0 - fine_z, fine, rasterized=True)
    brightest = ring()
    closer.plot(
        brightest["azimuth"], brightest["elevation"], "o", ms=8, mfc="none", mec="white", mew=1.6
    )
    closer.set_xlabel("azimuth of the observer (°)")
    closer.set_ylabel("its elevation (°)")
    closer.set_title("fig. 7, the ring and its top", loc="left")
    figure.colorbar(picture, ax=closer, label="specular |∂E/∂δα| (1/rad)")
    _best(figure.add_subplot(grid[1, :5]))
    _script.save(figure, args.out, "wang")


def _dress(axes, title: str) -> None:
    axes.set_title(title, fontsize=9.5, pad=8)
    axes.set_ylim(0.0, 90.0)
    axes.set_yticks([30.0, 60.0], ["60°", "30°"], fontsize=7, color="white")
    axes.set_xticks(np.radians([90.0, 270.0]), ["90°", "270°"], fontsize=7)
    axes.grid(color="white", lw=0.3, alpha=0.5)


def _best(axes) -> None:
    suns = np.arange(5.0, 90.1, 1.0)
    best = np.array([best_observer(float(sun)) for sun in suns])
    axes.plot(
        suns, best[:, 0], color=style.colour(0), lw=1.4, label="best elevation of the observer"
    )
    axes.set_xlabel("elevation of the Sun (°)")
    axes.set_ylabel("elevation of the observer (°)", color=style.colour(0))
    pair, _ = best_pair((35.0, 60.0))
    for point in (pair, pair[::-1]):
        axes.plot(*point, "o", ms=7, mfc="none", mec=style.INK, mew=1.2)
    axes.plot(48.0, 48.0, "x", ms=7, color=style.INK)
    other = axes.twinx()
    other.plot(suns, best[:, 1], color=style.colour(1), lw=1.1, ls="--")
    other.set_ylabel("diffuse |∂E/∂δα| there (1/rad)", color=style.colour(1))
    other.spines["right"].set_visible(True)
    axes.set_title("best pairs (circles: best of all; cross: both 48°)", loc="left")


if __name__ == "__main__":
    main()
