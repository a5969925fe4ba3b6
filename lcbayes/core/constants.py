"""Physical and calendar constants, each with its source."""

from __future__ import annotations

import math

MINUTE_S, HOUR_S, DAY_S = 60.0, 3600.0, 86400.0
AU_KM = 149_597_870.7  # IAU 2012, resolution B2
SUN_RADIUS_KM = 695_700.0  # nominal, IAU 2015, resolution B3
SUN_ANGULAR_RADIUS = math.radians(0.267)  # at 1 au, rad
SOLAR_FLUX_VISIBLE = 455.0  # W/m², Linares & Crassidis below eq. (5); Hinks et al. below eq. (3)
EARTH_RADIUS_KM = 6378.137  # at the equator, WGS84
EARTH_FLATTENING = 1.0 / 298.257223563  # WGS84
EARTH_GM = 398600.4418  # km³/s², EGM2008
EARTH_J2 = 1.08262668e-3  # EGM2008
EARTH_RATE = 7.292115e-5  # rad/s, IERS Conventions 2010
OBLIQUITY = math.radians(84381.406 / HOUR_S)  # of the ecliptic at J2000, rad, IAU 2006
