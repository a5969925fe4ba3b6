"""Readers of published tables: MMT-9 text, IAU SCORE CSV, Pomenis CSV."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lcbayes.core.errors import InputError
from lcbayes.core.files import TextFile
from lcbayes.data.formats.build import build
from lcbayes.data.formats.columns import NUMERIC, RADEC, SITE, TEXTS, Options
from lcbayes.data.formats.satchecker import RATES, observed_velocity
from lcbayes.data.formats.table import Table, header_of, parse
from lcbayes.data.lightcurve import LightCurve

MMT9_SITE = "43.65,41.431,2030"  # Nizhny Arkhyz, from SCORE
POMENIS_SITE = "32.4434,-110.7881,2790"  # Mt Lemmon, from the first lines of the file
MMT9_COLUMNS = ("Date", "Time", "StdMag", "Mag", "Filter", "Penumbra", "Distance", "Phase")
SCORE_COLUMNS = {
    "observation_time_utc": "utc",
    "apparent_magnitude": "mag",
    "apparent_magnitude_uncertainty": "mag_err",
    "observer_latitude_deg": "site_lat_deg",
    "observer_longitude_deg": "site_lon_deg",
    "observer_altitude_m": "site_height_m",
    "sat_ra_deg_satchecker": "ra_deg",
    "sat_dec_deg_satchecker": "dec_deg",
    "range_to_sat_km_satchecker": "range_km",
    "observing_filter": "band",
}
POMENIS_COLUMNS = {
    "observation_time": "utc",
    "satellite_height": "height_km",
    "satellite_altitude": "altitude_deg",
    "satellite_azimuth": "azimuth_deg",
    "ab_magnitude": "mag",
}
MAX_PHASE_ERROR_DEG = 1.0


def dialect_of(text: str) -> str | None:
    """Which of these formats a text has, from its header."""
    if _mmt9_header(text):
        return "mmt9"
    columns = set(header_of(text)[1].split(","))
    if {"satellite_name", "observation_time_utc", "apparent_magnitude"} <= columns:
        return "score"
    if columns >= POMENIS_COLUMNS.keys():
        return "pomenis"
    return None


def _mmt9_header(text: str) -> list[str]:
    """Column names of an MMT-9 file, from its last comment; empty for other files."""
    for line in text[:65536].split("\n"):
        names = line.lstrip("# ").split()
        if line.startswith("#") and tuple(names[:4]) == MMT9_COLUMNS[:4]:
            return names
        if line.strip() and not line.startswith("#"):
            break
    return []


def read_mmt9(file: TextFile, options: Options) -> LightCurve:
    """Read an MMT-9 track file: UTC, calibrated magnitudes, one curve per track.

    The brightness is `Mag` (`StdMag` is corrected by a phase law). The file contains no directions,
    so two-line elements are required; the site is that of MMT-9 unless another is given. Points
    marked as in penumbra are left out and counted in a note. The phase angle and the distance in
    the file must agree with the elements to 1° and 5 %.
    """
    header = _mmt9_header(file.text)
    missing = [name for name in MMT9_COLUMNS if name not in header]
    if missing:
        raise InputError(
            f"{file.name} lacks the MMT-9 columns {', '.join(missing)}; expected the line "
            f"'# {' '.join(MMT9_COLUMNS)} Channel Track'"
        )
    if options.tle is None:
        raise InputError(
            f"{file.name} is MMT-9 text, which gives no directions; add --tle FILE with the "
            "object's elements of that date"
        )
    rename = {"Mag": "mag", "Filter": "band", "Distance": "range_km", "Track": "curve"}
    table = parse(file, NUMERIC | {"StdMag", "Phase"}, rename, " ", header)
    date, clock = table.texts.pop("Date"), table.texts.pop("Time")
    table.texts["utc"] = np.char.add(np.char.add(date, "T"), clock)
    sunlit = ~_true(table, "Penumbra")
    if "curve" not in table:
        table.texts["curve"] = np.full(len(table), "0")
    table, notes = _without(table, ~sunlit, "in penumbra")
    if options.site is None:
        options = replace(options, site=MMT9_SITE)
        notes += (f"seen from the site of MMT-9 ({MMT9_SITE})",)
    table = _sorted(table)
    curve = build(table, options, "mmt9", notes)
    off = np.abs(np.degrees(curve.phase_angle) - table.number("Phase"))
    remedy = f"check that {options.tle} is of this object and date, and the site"
    table.reject("Phase", off > MAX_PHASE_ERROR_DEG, "that the elements contradict", remedy)
    return curve


def read_score(file: TextFile, options: Options) -> LightCurve:
    """Read an export of IAU CPS SCORE: calibrated magnitudes, one curve per satellite.

    Celestial coordinates and velocities are those added by SatChecker. Rows are sorted by time
    within each satellite. Each row has its own site. SCORE does not name sites, so the name is
    composed of the MPC code or the coordinates, and the instrument. Rows without a magnitude, an
    uncertainty or coordinates, and rows below the horizon (wrong matches), are left out and counted
    in notes. The file's flag for the Earth's shadow is not used: points observed although the
    satellite should be dark are wrong matches or have wrong elements, and are kept for a noise law
    with outliers.
    """
    may_lack = {"mag", "mag_err", "alt_deg_satchecker", *RADEC, *RATES}
    table = parse(file, NUMERIC | may_lack, SCORE_COLUMNS, may_be_empty=may_lack, texts=TEXTS)
    wanted = {"a place in the sky": RADEC}
    if not options.geometry_only:
        wanted = {"a magnitude": ("mag",)} | wanted
        if options.error is None:
            wanted["an uncertainty"] = ("mag_err",)
    notes: tuple[str, ...] = ()
    for what, names in wanted.items():
        empty = [np.isnan(table.numbers[name]) for name in names if name in table]
        if empty:
            table, more = _without(table, np.any(empty, axis=0), f"without {what}")
            notes += more
    if "alt_deg_satchecker" in table:
        table, more = _without(table, table.numbers["alt_deg_satchecker"] < 0, "below the horizon")
        notes += more
    table.texts["curve"] = table.texts["satellite_name"]
    if all(name in table for name in SITE[:2]):
        table.texts["site"] = _score_sites(table)
    table = _sorted(table)
    rates = {name: table.numbers.pop(name) for name in RATES if name in table}
    curve = build(table, options, "score", notes)
    velocity, more = observed_velocity(curve, rates)
    extra = dict(curve.extra) | {table.label(name): v for name, v in rates.items()}
    source = dict(curve.source)
    if more:
        source["notes"] = "; ".join([*filter(None, [source.get("notes", "")]), more])
    return replace(curve, velocity_km_s=velocity, extra=extra, source=source)


def _score_sites(table: Table) -> np.ndarray:
    """Name of each row's site: its MPC code or coordinates, and its instrument."""
    none = np.full(len(table), "")
    code = table.texts.get("mpc_code", none)
    device = table.texts.get("instrument", none)
    lat, lon = (table.number(name) for name in SITE[:2])
    rows = zip(code, lat, lon, device, strict=True)
    return np.array(
        [
            " ".join(
                filter(
                    None,
                    (
                        str(mpc)
                        or f"{abs(y):.3f}{'NS'[int(y < 0)]} {abs(x):.3f}{'EW'[int(x < 0)]}",
                        "" if name.lower() == "none" else str(name),
                    ),
                )
            )
            for mpc, y, x, name in rows
        ]
    )


def read_pomenis(file: TextFile, options: Options) -> LightCurve:
    """Read Pomenis magnitudes: AB magnitudes of many satellites of one type, as one curve.

    The site is Mt Lemmon unless another is given. Heights are above the WGS84 ellipsoid. Rows are
    sorted by time.
    """
    table = parse(file, NUMERIC, POMENIS_COLUMNS, texts=TEXTS)
    table.texts["curve"] = np.full(len(table), "0")
    notes: tuple[str, ...] = ()
    if options.site is None:
        options = replace(options, site=POMENIS_SITE)
        notes = (f"seen from Mt Lemmon ({POMENIS_SITE})",)
    return build(_sorted(table), options, "pomenis", notes)


def _true(table: Table, name: str) -> np.ndarray:
    return ~np.isin(np.char.lower(table.texts[name]), ("0", "0.0", "false", "none", ""))


def _without(table: Table, bad: np.ndarray, why: str) -> tuple[Table, tuple[str, ...]]:
    """The table without some rows, and a note with their number."""
    count = int(bad.sum())
    if not count:
        return table, ()
    if count == len(table):
        raise InputError(
            f"{table.file.name}: all {count} points are {why}; nothing is left to read"
        )
    return table.drop(bad), (f"{count} {'point' if count == 1 else 'points'} {why} left out",)


def _sorted(table: Table) -> Table:
    """The table as calibrated points, sorted by time within each curve.

    Equal times are kept: in a catalogue they are separate measurements.
    """
    cells = np.char.rstrip(table.texts["utc"], "Z")  # all in one format, so they sort as text
    table = table.take(np.lexsort((cells, table.texts["curve"])))
    table.texts["calibrated"] = np.full(len(table), "1")
    table.meta["repeated_times"] = ("allowed", 0)
    return table
