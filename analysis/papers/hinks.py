"""Figures 2 to 6 of Hinks, Linares & Crassidis 2013: one facet around its glint, and a small table.

The facet's normal is moved about the half vector; the axes are the projections of the normal on the
plane perpendicular to it (pitch and roll, in degrees). Shown are the magnitude (fig. 2), the
information of one measurement (fig. 3), and the derivatives of the magnitude: its norm with respect
to attitude (fig. 4), and those with respect to R_spec (fig. 5) and n_uv (fig. 6). Each is drawn
along the pitch axis, next to a map. The paper does not give R_spec, R_diff, area, phase angle or σ;
here they are 0.5, 0.5, 10 m², 40 deg and 0.1 mag. n_u = n_v = 1000 and a distance near GEO are from
the paper.
"""

from __future__ import annotations

import csv
from pathlib import Path

import _script
import numpy as np
from numpy.typing import NDArray

from lcbayes.analysis import style
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.physics import photometry
from lcbayes.physics.sensitivity import MAGNITUDE_PER_NEPER, closed_form, magnitude_gradient

Floats = NDArray[np.float64]
LAW = "ashikhmin-shirley-distribution"
SURFACE = {"r_spec": 0.5, "r_diff": 0.5, "nu": 1000.0}
AREA, RANGE_M, PHASE_DEG, SIGMA = 10.0, 36_000e3, 40.0, 0.1
NEAR_DEG = 10.0  # half width of figs. 4 to 6


class Facet:
    """Magnitude and its derivatives with the normal at pitch and roll (deg) from the half
    vector."""

    def __init__(self, pitch: Floats, roll: Floats) -> None:
        p, r = np.sin(np.radians(pitch)), np.sin(np.radians(roll))
        up = np.sqrt(np.maximum(1.0 - p**2 - r**2, 0.0))
        normals = np.stack([p, r, up], axis=-1).reshape(-1, 3)
        half = np.radians(PHASE_DEG) / 2.0
        # pitch is the rotation in the plane of Sun and observer; the half vector is along z
        sun = jnp.array([[np.sin(half), 0.0, np.cos(half)]])
        obs = sun * jnp.array([-1.0, 1.0, 1.0])
        shape = np.shape(pitch)
        # Sun and observer are fixed, and each normal is a separate facet
        sensitivities = closed_form(
            sun, obs, jnp.asarray(normals), jnp.full(len(normals), AREA), LAW, SURFACE
        )
        flux = np.asarray(sensitivities.flux[0])
        turn = _each(sun, obs, normals)
        self.mag = np.asarray(
            photometry.magnitude(jnp.asarray(flux), RANGE_M, photometry.SUN_MAGNITUDE["hinks"])
        ).reshape(shape)
        lit = flux > 0.0
        slope = np.linalg.norm(magnitude_gradient(jnp.asarray(flux), jnp.asarray(turn)), axis=1)
        self.slope = np.where(lit, slope, np.nan).reshape(shape)
        self.by = {
            name: np.where(
                lit, -MAGNITUDE_PER_NEPER * d[0] / np.where(lit, flux, 1.0), np.nan
            ).reshape(shape)
            for name, d in sensitivities.parameters.items()
        }
        self.mag = np.where(lit.reshape(shape), self.mag, np.nan)


def _each(sun, obs, normals: Floats) -> Floats:
    """∂flux/∂δα of each single facet, (N, 3)."""

    def one(normal):
        return closed_form(sun, obs, normal[None], jnp.array([AREA]), LAW, SURFACE).attitude[0]

    return np.asarray(jax.jit(jax.vmap(one))(jnp.asarray(normals)))


def numbers() -> list[tuple[str, str]]:
    """The main numbers of the figures, as rows of a table."""
    pitch = np.linspace(-90.0, 90.0, 360_001)
    cut = Facet(pitch, np.zeros_like(pitch))
    at_glint = int(np.argmin(np.abs(pitch)))
    near = np.abs(pitch) < NEAR_DEG
    top = int(np.nanargmax(np.where(near, cut.slope, np.nan)))
    far = (np.abs(pitch) > 12.0) & (np.abs(pitch) < 40.0)
    r_spec, r_diff = SURFACE["r_spec"], SURFACE["r_diff"]
    expected = MAGNITUDE_PER_NEPER / (1.0 - r_spec)  # (25) with ρ_diff = ρ_total
    typical = {
        "attitude 1 deg": cut.slope[top] * np.radians(1.0),
        "R_spec 0.05": 0.05 * np.nanmax(np.abs(cut.by["r_spec"][near])),
        "n_uv 100": 100.0 * np.nanmax(np.abs(cut.by["nu"][near])),
    }
    edge = np.abs(np.abs(pitch) - (90.0 - PHASE_DEG / 2.0)) < 0.5
    rows = [
        ("fig. 2: magnitude at the glint", f"{cut.mag[at_glint]:.2f} mag"),
        ("fig. 2: brightest attitude", f"{pitch[np.nanargmin(cut.mag)]:.2f} deg from the glint"),
        ("fig. 2: 20 deg away", f"{cut.mag[np.argmin(np.abs(pitch - 20.0))]:.2f} mag"),
        (
            "fig. 3: information at its peak near the glint",
            f"{(cut.slope[top] / SIGMA) ** 2:.3g} /rad²",
        ),
        (
            "fig. 3: information within 0.5 deg of the edge, largest",
            f"{(np.nanmax(cut.slope[edge]) / SIGMA) ** 2:.3g} /rad²",
        ),
        (
            "fig. 3: information 30 deg away",
            f"{(cut.slope[np.argmin(np.abs(pitch - 30.0))] / SIGMA) ** 2:.3g} /rad²",
        ),
        ("fig. 4: slope at the glint", f"{cut.slope[at_glint]:.2g} mag/rad"),
        ("fig. 4: largest slope", f"{cut.slope[top]:.1f} mag/rad, {abs(pitch[top]):.2f} deg away"),
        ("fig. 5: by R_spec at the glint", f"{cut.by['r_spec'][at_glint]:.3f} mag"),
        (
            "fig. 5: by R_spec, 12 to 40 deg away",
            f"{np.nanmin(cut.by['r_spec'][far]):.4f} to {np.nanmax(cut.by['r_spec'][far]):.4f} mag",
        ),
        ("fig. 5: the same by (25)", f"{expected:.4f} mag"),
        (
            "below fig. 5: by R_diff there, negative of it for R_diff = 1 − R_spec",
            f"{np.nanmean(cut.by['r_diff'][far]):.4f} mag (R_diff {r_diff:g}, R_spec {r_spec:g})",
        ),
        ("fig. 6: by n_uv at the glint", f"{cut.by['nu'][at_glint]:.2e} mag"),
        ("fig. 6: by n_uv, largest positive", f"{np.nanmax(cut.by['nu'][near]):.2e} mag"),
        *((f"largest change near the glint for {k}", f"{v:.3g} mag") for k, v in typical.items()),
    ]
    return rows


def write_table(rows: list[tuple[str, str]], folder: Path, name: str) -> None:
    """Print the table and save it next to the figure."""
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / f"{name}.csv").open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([("quantity", "value"), *rows])
    for what, value in rows:
        print(f"{what:72s} {value}")


def main() -> None:
    from matplotlib.colors import LogNorm

    args = _script.parser(__doc__ or "").parse_args()
    write_table(numbers(), args.out, "hinks")
    wide, near = np.linspace(-89.0, 89.0, 401), np.linspace(-NEAR_DEG, NEAR_DEG, 401)
    maps = {
        span: Facet(*np.meshgrid(axis, axis)) for span, axis in (("wide", wide), ("near", near))
    }
    panels = (
        ("fig. 2: magnitude", wide, maps["wide"].mag, "viridis_r", None),
        (
            "fig. 3: information (1/rad²)",
            wide,
            (maps["wide"].slope / SIGMA) ** 2,
            "viridis",
            LogNorm(1e1, 1e7),
        ),
        ("fig. 4: |∂m/∂δα| (mag/rad)", near, maps["near"].slope, "viridis", None),
        ("fig. 5: ∂m/∂R_spec (mag)", near, maps["near"].by["r_spec"], "viridis", None),
        ("fig. 6: ∂m/∂n_uv (mag)", near, maps["near"].by["nu"], "viridis", None),
    )
    figure = _script.figure(13.0, 5.2)
    axes = figure.subplots(2, 5, height_ratios=(1.0, 0.62))
    for (title, axis, values, cmap, norm), upper, lower in zip(panels, *axes, strict=True):
        picture = upper.pcolormesh(axis, axis, values, cmap=cmap, norm=norm, rasterized=True)
        upper.set_aspect("equal")
        upper.set_title(title, loc="left")
        upper.set_ylabel("roll (°)")
        figure.colorbar(picture, ax=upper, location="bottom", shrink=0.9, pad=0.02)
        lower.plot(axis, values[len(axis) // 2], color=style.colour(0), lw=1.1)
        lower.set_xlabel("pitch (°), roll 0")
        if norm is not None:
            lower.set_yscale("log")
        if title.startswith("fig. 2"):
            lower.invert_yaxis()
    _script.save(figure, args.out, "hinks")


if __name__ == "__main__":
    main()
