"""The files of a DAMIT model: ``shape.txt`` and ``spin.txt``.

``shape.txt``: numbers of vertices and triangles; a row x y z for each vertex; a row of three
vertex numbers for each triangle, from 1, counter-clockwise as seen from outside. The z axis is the
spin axis.

``spin.txt``: λ and β of the pole (deg, ecliptic J2000) and the sidereal period P (h); JD₀ and φ₀
(deg); then the scattering law, with a, d (rad) and k (1/rad) of S = a exp(−phase/d) + k phase + 1
in one row, and the weight c of the Lambert term in the last, as convexinv writes them.

References
----------
Documentation of DAMIT, https://damit.cuni.cz/projects/damit/pages/documentation; Ďurech, Sidorin
& Kaasalainen 2010, A&A 513, A46; convexinv.c of the DAMIT-convex distribution (Kaasalainen &
Ďurech), where the parameters are written.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Scattering(NamedTuple):
    """S(phase) [μ₀μ/(μ₀+μ) + c μ₀μ] with S = a exp(−phase/d) + k phase + 1, phase in rad.

    The default is S = 1: relative light curves do not determine the phase law.
    """

    c: float
    a: float = 0.0
    d: float = 0.1
    k: float = 0.0


def shape_text(vertices: NDArray[np.float64], triangles: NDArray[np.integer]) -> str:
    """The content of ``shape.txt``.

    Parameters
    ----------
    vertices : (V, 3)
    triangles : (F, 3) int
        Indices into ``vertices``, from 0.

    Examples
    --------
    >>> print(shape_text(np.eye(3), np.array([[0, 1, 2]])).splitlines()[0])
    3 1
    """
    rows = [f"{len(vertices)} {len(triangles)}"]
    rows += [f"{x:.10g} {y:.10g} {z:.10g}" for x, y, z in vertices]
    rows += [f"{i + 1} {j + 1} {k + 1}" for i, j, k in triangles]
    return "\n".join(rows) + "\n"


def spin_text(
    pole_lon_deg: float,
    pole_lat_deg: float,
    period_h: float,
    epoch_jd: float,
    phase0_deg: float,
    scattering: Scattering,
) -> str:
    """The content of ``spin.txt``; the period has as many digits as decades of data require.

    Examples
    --------
    >>> print(spin_text(272.0, 52.0, 8.4006, 2449000.0, 120.0, Scattering(0.1)), end="")
    272.000000 +52.000000 8.400600000000
    2449000.000000 120.000000
    0 0.1 0
    0.1
    """
    a, d, k = scattering.a, scattering.d, scattering.k
    return (
        f"{pole_lon_deg:.6f} {pole_lat_deg:+.6f} {period_h:.12f}\n"
        f"{epoch_jd:.6f} {phase0_deg:.6f}\n"
        f"{a:.8g} {d:.8g} {k:.8g}\n"
        f"{scattering.c:.8g}\n"
    )
