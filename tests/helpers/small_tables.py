"""Light curves as a user would type them: a pass over Rhodes, and directions that are given."""

from __future__ import annotations

# The pass over Rhodes, for which `object.tle` and `SITE` of `mistakes.py` are correct.
PLACES = (
    ("2026-04-15T19:53:00Z", 90.074, 12.285, 1800.7),
    ("2026-04-15T19:53:20Z", 87.057, 15.979, 1821.9),
    ("2026-04-15T19:53:40Z", 83.943, 19.476, 1853.7),
    ("2026-04-15T19:54:00Z", 80.748, 22.736, 1895.3),
    ("2026-04-15T19:54:20Z", 77.488, 25.732, 1946.2),
    ("2026-04-15T19:54:40Z", 74.180, 28.445, 2005.6),
    ("2026-04-15T19:55:00Z", 70.848, 30.870, 2072.8),
    ("2026-04-15T19:55:20Z", 67.510, 33.007, 2146.9),
    ("2026-04-15T19:55:40Z", 64.191, 34.867, 2227.3),
)
MAGS = [7.0 + 0.11 * (i * i % 7) for i in range(len(PLACES))]
PASS = "utc,mag,mag_err\n" + "".join(
    f"{utc},{mag:.2f},0.02\n" for (utc, *_), mag in zip(PLACES, MAGS, strict=True)
)
VECTORS = "t,flux,flux_err,sun_x,sun_y,sun_z,obs_x,obs_y,obs_z\n" + "".join(
    f"{10 * i},{7.0 + 0.1 * (i % 5):.1f},0.1,1,0,0,0,1,0\n" for i in range(12)
)


def sky(ra_unit: float = 1.0, range_unit: float = 1.0, hours: int = 0) -> str:
    """The pass with its right ascensions and ranges in other units, or its clock shifted."""
    rows = "".join(
        f"{utc.replace('T19', f'T{(19 + hours) % 24:02d}')},{mag:.2f},0.02,{ra / ra_unit:.4f},"
        f"{dec},{distance * range_unit:.1f}\n"
        for (utc, ra, dec, distance), mag in zip(PLACES, MAGS, strict=True)
    )
    return "utc,mag,mag_err,ra_deg,dec_deg,range_km\n" + rows
