"""Motions of a known body that have the same brightness, as matrices on the sites of its motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lcbayes.simulation.known_bodies.body import KnownBody

Floats = NDArray[np.float64]
type Change = dict[str, Floats]  # site → matrix


def equivalents(known: KnownBody, spin: str, signs: Sequence[float] = (1.0, -1.0)) -> list[Change]:
    """Changes that give the same motion of the same body, the first of which is the identity.

    A body that looks the same after a rotation G of its axes has the attitudes A and A G; and each
    rotation is two quaternions, or one of these ``signs`` alone.
    """
    symmetry = known.symmetry
    if spin == "free" and symmetry.axis is not None:
        flips = any(m @ symmetry.axis @ symmetry.axis < 0.0 for m in symmetry.rotations)
        return [{"axis_base": sign * np.eye(3)} for sign in ((1.0, -1.0) if flips else (1.0,))]
    distinct = []
    for rotation in symmetry.rotations:
        along = float(rotation @ known.flat_axis @ known.flat_axis)
        if spin == "flat" and abs(abs(along) - 1.0) > 1e-6:
            continue
        right = _right(Rotation.from_matrix(rotation).as_quat(scalar_first=True))
        for sign in signs:
            one = {"attitude_base": sign * right}
            if spin == "flat":
                one["rate_unit"] = np.array([[np.sign(along)]])
            distinct.append(one)
    return distinct


def mirrored(known: KnownBody, spin: str, normal: Floats) -> Change | None:
    """The reflection R in the plane of Sun and observer, of this normal, if the body has one too.

    If M is a reflection of the body, R A M and −R ω give the brightness of A and ω. −R is half a
    turn about the normal of the plane, and −M a rotation.
    """
    half = 2.0 * np.outer(normal, normal) - np.eye(3)
    left = np.concatenate([[0.0], normal])
    axis = known.symmetry.axis if spin == "free" else None
    for reflection in known.symmetry.reflections:
        along = float(-reflection @ known.flat_axis @ known.flat_axis)
        if spin == "flat" and abs(abs(along) - 1.0) > 1e-6:
            continue
        if axis is not None:
            return {"omega_unit": half, "axis_base": np.sign(-reflection @ axis @ axis) * half}
        right = _right(Rotation.from_matrix(-reflection).as_quat(scalar_first=True))
        sites = {"attitude_base": _left(left) @ right}
        if spin == "flat":
            return sites | {"rate_unit": np.array([[np.sign(along)]])}
        return sites | {"omega_unit": half}
    return None


def _left(q: Floats) -> Floats:
    """The matrix (4, 4) of the product of a quaternion with q on its left."""
    w, x, y, z = q
    return np.array([[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]])


def _right(q: Floats) -> Floats:
    """The matrix (4, 4) of the product of a quaternion with q on its right."""
    w, x, y, z = q
    return np.array([[w, -x, -y, -z], [x, w, z, -y], [y, -z, w, x], [z, y, -x, w]])
