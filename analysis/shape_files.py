"""The files of a body: OBJ, STL, and DAMIT's ``shape.txt`` and ``spin.txt``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr

from lcbayes.analysis.contents import Mode, Results
from lcbayes.core.constants import DAY_S
from lcbayes.data.formats.damit_model import Scattering, shape_text, spin_text
from lcbayes.geometry.spherical import unit_vector
from lcbayes.inversion.attitude_scan.result import AttitudeScan
from lcbayes.physics.attitude.spin_state import SpinState
from lcbayes.physics.bodies.polyhedron import Polyhedron
from lcbayes.physics.brightness import LAMBERT_C

ECLIPTIC = "ecliptic-j2000"


@dataclass(frozen=True)
class DamitModel:
    """The spin and the surface that belong to a body, in the convention of DAMIT."""

    spin: SpinState
    scattering: Scattering

    @property
    def comment(self) -> str:
        """The spin as text for files that have no place for it."""
        s = self.spin
        return (
            "body axes: z is the spin axis; inertial axes: ecliptic J2000\n"
            "r_ecl = Rz(lambda) Ry(90 deg - beta) Rz(phi0 + 360 deg (t - JD0)/P) r_body\n"
            f"lambda {s.pole_lon_deg:.6f} deg, beta {s.pole_lat_deg:+.6f} deg, "
            f"P {s.period_h:.12f} h\n"
            f"JD0 {s.epoch_jd:.6f} (light-time corrected), phi0 {s.phase0_deg:.6f} deg"
        )

    @property
    def header(self) -> str:
        """The spin in the 80 bytes of the header of an STL file."""
        s = self.spin
        return (
            f"ecl J2000 {s.pole_lon_deg:.3f} {s.pole_lat_deg:+.3f} deg "
            f"P {s.period_h:.9f} h JD0 {s.epoch_jd:.1f} phi0 {s.phase0_deg:.3f} deg"
        )


def write_body(
    folder: Path, body: Polyhedron, tail: str, comment: str, model: DamitModel | None
) -> None:
    """Write ``shape.obj`` and ``shape.stl``, and with a model ``shape.txt`` and ``spin.txt``.

    Parameters
    ----------
    tail : text before the suffix, such as "-2" for the second solution
    comment : lines at the top of the OBJ file
    model : spin and surface; None if the body has no spin in the convention of DAMIT
    """
    lines = comment if model is None else f"{comment}\n{model.comment}"
    (folder / f"shape{tail}.obj").write_text(body.obj(lines), encoding="utf-8")
    header = "made by lcbayes" if model is None else model.header
    (folder / f"shape{tail}.stl").write_bytes(body.stl(header))
    if model is not None:
        text = shape_text(body.vertices, body.triangles)
        (folder / f"shape{tail}.txt").write_text(text, encoding="utf-8")
        s = model.spin
        text = spin_text(
            s.pole_lon_deg,
            s.pole_lat_deg,
            s.period_h,
            s.epoch_jd,
            s.phase0_deg,
            model.scattering,
        )
        (folder / f"spin{tail}.txt").write_text(text, encoding="utf-8")


def model_of_fit(results: Results, mode: Mode) -> DamitModel | None:
    """The posterior mean of spin and surface; None unless the fit is of an asteroid.

    The fit must be in ecliptic axes, have absolute times, and describe a body on a fixed grid of
    normals that rotates about a fixed pole.
    """
    draws, epoch = mode.draws, results.attrs.get("epoch_jd")
    needed = {"pole_lon_deg", "pole_lat_deg", "period_h", "lambert_c"}
    if epoch is None or results.frame != ECLIPTIC or results.normals is None:
        return None
    if not needed <= set(map(str, draws.data_vars)):
        return None
    middle = float(epoch) + 0.5 * results.span_s / DAY_S
    pole = mean_pole(draws)
    spin = SpinState.of_pole(pole, float(draws["period_h"].mean()), middle)
    laws = {k: draws[f"phase_{k}"] for k in "adk" if f"phase_{k}" in draws}
    law = {k: float(x.isel(phase_law=0, missing_dims="ignore").mean()) for k, x in laws.items()}
    return DamitModel(spin, Scattering(float(draws["lambert_c"].mean()), **law))


def mean_pole(draws: xr.Dataset) -> np.ndarray:
    """The mean direction of the pole (3,), of unit length."""
    lon, lat = (np.radians(draws[k].to_numpy()) for k in ("pole_lon_deg", "pole_lat_deg"))
    mean = unit_vector(lon, lat).reshape(-1, 3).mean(axis=0)
    return mean / np.linalg.norm(mean)


def model_of_scan(scan: AttitudeScan) -> DamitModel | None:
    """Spin and surface of the best solution; None unless it is a spin of an asteroid."""
    best = scan.solutions[0]
    if scan.epoch_jd is None or scan.frame != ECLIPTIC or not scan.settings.smooth:
        return None
    if best.pole is None or best.frequency is None:
        return None
    middle = scan.epoch_jd + 0.5 * (scan.t.min() + scan.t.max()) / DAY_S
    period_h = best.spin()["period_h"]
    return DamitModel(SpinState.of_pole(best.pole, period_h, middle), Scattering(LAMBERT_C))
