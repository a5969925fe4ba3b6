"""A bar with an arm that shades itself, in flat spin: its drawing and its light curve by rays."""

from __future__ import annotations

import json

import numpy as np
from scipy.spatial.transform import Rotation

from lcbayes.data.lightcurve import LightCurve
from tests.helpers import small_curves
from tests.helpers import turning_bodies as turning
from tests.helpers.l_shaped_body import boxes, flux

ARM, ALBEDO = 0.5, 0.4
BAR = f"""
[body]
shadows = SHADOWS
spin_axis = [0.3, 1.0, 0.2]
[[body.parts]]
kind = "box"
x = 2.0
y = 1.0
z = 1.0
position = [1.0, 0.5, 0.5]
[[body.parts]]
kind = "box"
x = 1.0
y = 1.0
z = LENGTH
position = [0.5, 0.5, {1.0 + 0.5 * ARM}]
[materials.paint]
law = "lambertian"
r_diff = {{ low = 0.1, high = 0.9 }}
"""
ATTITUDE = Rotation.from_rotvec([0.7, -1.1, 0.4]).as_matrix()
AXIS = np.array([0.3, 1.0, 0.2]) / np.linalg.norm([0.3, 1.0, 0.2])
OMEGA = 0.07 * ATTITUDE @ AXIS
T, SUN, OBS = turning.geometry((0.0, 900.0), 40, 200.0)


def bar(shadows: bool = False, length: object = ARM) -> str:
    return BAR.replace("SHADOWS", json.dumps(shadows)).replace("LENGTH", str(length))


def shaded_flux() -> np.ndarray:
    seen = turning.in_body(T, ATTITUDE, OMEGA, SUN, OBS)
    return ALBEDO * flux(boxes(ARM), *seen, per_side=60)


def curve(brightness: np.ndarray, snr: float) -> LightCurve:
    return small_curves.of_flux(T, brightness, brightness.mean() / snr, SUN, OBS)
