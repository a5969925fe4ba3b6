"""Light curves from tables with lcbayes column names, for all delimited formats."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.errors import InputError, RowError
from lcbayes.data.formats.columns import (
    ALTAZ,
    BRIGHTNESS,
    PLACE,
    RADEC,
    TIMES,
    VECTORS,
    VELOCITY,
    Options,
    need,
)
from lcbayes.data.formats.sky import computed_geometry
from lcbayes.data.formats.table import Table
from lcbayes.data.formats.times import seconds_from_jd, seconds_from_utc, utc_days_to_seconds
from lcbayes.data.lightcurve import FRAMES, LightCurve

Floats = NDArray[np.float64]

BRIGHTEST_MAG, FAINTEST_MAG = -30.0, 40.0  # 99.99 and -99 mark missing values
LARGEST_MAG_ERROR = 9.0
LARGEST_ALBEDO_AREA = 1e6  # m², of a body nearer than `NEAR_KM`
NEAR_KM = 1e6
SOLAR_FLUX = 455.0  # W/m² at 1 au in the visible band, for order-of-magnitude checks
KEPT_UNIT = 1e-14  # a length this close to 1 is kept, so that rewriting is lossless


def build(
    table: Table, options: Options, file_format: str, notes: tuple[str, ...] = ()
) -> LightCurve:
    """The light curve a table describes.

    Raises
    ------
    InputError
        The message names file, line, column and remedy.
    """
    used: set[str] = set()
    t, epoch_jd, time_name = _times(table, used)
    kind, brightness, error, labels = _brightness(table, options, used)
    curve, names = _curves(table, used)
    optional: dict[str, Any] = {
        name: table.texts[name] for name in ("band", "site") if name in table
    }
    if "exposure_s" in table:
        optional["exposure_s"] = table.number("exposure_s")
    used |= {*optional}
    _check_order(table, t, curve, time_name)
    directions, more, extra = _geometry(table, options, t, epoch_jd, used)
    absolute = kind == "flux" or directions.get("range_km") is not None
    free_scale, unknown = _free_scale(table, used, curve, len(names), absolute)
    if kind == "flux" and not options.geometry_only:
        unknown += _check_flux(table, brightness, directions.get("range_km"), free_scale[curve])
    columns = table.texts | table.numbers
    kept = {table.label(name): columns[name] for name in columns if name not in used}
    try:
        return LightCurve(
            t=t,
            brightness=brightness,
            error=error,
            kind=kind,
            curve=curve,
            free_scale=free_scale,
            curve_names=names,
            epoch_jd=epoch_jd,
            extra=kept | extra,
            source=source_of(table, file_format, (*notes, *more, *unknown)),
            **optional,
            **directions,
        )
    except RowError as fault:
        label = {"t": time_name, **labels}.get(fault.name, fault.name)
        raise fault.located(table.label(label), table.at(fault.row)) from None


def source_of(table: Table, file_format: str, notes: tuple[str, ...]) -> dict[str, str]:
    """Origin of a curve."""
    notes = table.file.notes + notes
    return {
        "file": table.file.name,
        "format": file_format,
        "sha256": table.file.sha256,
        **({"notes": "; ".join(notes)} if notes else {}),
    }


def _one_column(table: Table, names: tuple[str, ...], what: str) -> str | None:
    given = [name for name in names if name in table]
    if len(given) > 1:
        raise InputError(
            f"{table.file.name} gives {what} more than once ({', '.join(given)}); keep one of "
            "these columns"
        )
    return given[0] if given else None


def _times(table: Table, used: set[str]) -> tuple[Floats, float | None, str]:
    name = _one_column(table, TIMES, "the time")
    if name is None:
        raise InputError(
            f"{table.file.name} has no column of times; expected one of: utc, jd, mjd, t (found: "
            f"{_shown(table)}); name it with --columns t=NAME if it is in seconds, or utc=NAME, "
            "jd=NAME, mjd=NAME"
        )
    used.add(name)
    if name == "utc":
        return *seconds_from_utc(table, name), name
    values = table.number(name)
    if name == "jd":
        table.reject("jd", (values < 2415020.0) | (values > 2488070.0), *_JD_RANGE)
        t, epoch = seconds_from_jd(values)
        return utc_days_to_seconds(t, epoch), epoch, name
    if "epoch_jd" not in table.meta:
        return values, None, name
    text, line = table.meta["epoch_jd"]
    try:
        epoch_jd = float(text)
    except ValueError:
        epoch_jd = np.nan
    if not 2.3e6 < epoch_jd < 2.6e6:  # days from another origin give a wrong position of the Sun
        raise InputError(
            f"{table.file.at(line)}: epoch_jd is {text!r}; expected a Julian date of the years "
            "1585 .. 2406 (MJD + 2400000.5)"
        )
    return values, epoch_jd, name


_MISSING = "such values mark missing measurements: drop those rows"
_IN_MAG = f"{_MISSING}, or give errors in mag"
_JD_RANGE = (
    "outside the years 1900 .. 2099",
    "give full Julian dates (MJD + 2400000.5), UTC",
)


def _shown(table: Table) -> str:
    names = [table.label(name) for name in (*table.numbers, *table.texts)]
    return ", ".join(names[:12]) + (", …" if len(names) > 12 else "")


def _brightness(
    table: Table, options: Options, used: set[str]
) -> tuple[str, Floats, Floats | None, dict[str, str]]:
    kind = _one_column(table, BRIGHTNESS, "the brightness")
    if options.geometry_only:
        kind = kind or "mag"
        used |= {kind, f"{kind}_err"}
        return kind, np.full(len(table), np.nan), None, {}
    if kind is None:
        raise InputError(
            f"{table.file.name} has no column of brightness; expected flux or mag (found: "
            f"{_shown(table)}); name it with --columns mag=NAME or flux=NAME"
        )
    err = f"{kind}_err"
    other = "mag_err" if kind == "flux" else "flux_err"
    if other in table:
        raise InputError(
            f"{table.file.name} has {kind} with {table.label(other)}; expected {err}: the "
            "error in the unit of the brightness"
        )
    used |= {kind, err}
    values = table.number(kind)
    if kind == "mag":
        faint = (values < BRIGHTEST_MAG) | (values > FAINTEST_MAG)
        table.reject(kind, faint, f"outside {BRIGHTEST_MAG:g} .. {FAINTEST_MAG:g} mag", _MISSING)
    given = table.numbers.get(err)
    if given is not None and kind == "mag" and options.error is None:
        table.reject(err, given >= LARGEST_MAG_ERROR, f">= {LARGEST_MAG_ERROR:g} mag", _IN_MAG)
    if given is not None and options.error is None and options.error_floor is not None:
        given = table.number(err)  # before the error floor hides NaN
    error = options.errors(given, len(table), table.file.name)
    return kind, values, error, {"brightness": kind, "error": err}


def _curves(table: Table, used: set[str]) -> tuple[NDArray[np.int64], tuple[str, ...]]:
    """Group of each point, and group names in order of first appearance."""
    used.add("curve")
    if "curve" not in table:
        return np.zeros(len(table), np.int64), ("0",)
    column = table.texts["curve"]
    table.reject("curve", column == "", "empty", "name the curve of each row")
    labels, first, inverse = np.unique(column, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(order.size)
    return rank[inverse], tuple(labels[order].tolist())


def _free_scale(
    table: Table, used: set[str], curve: NDArray[np.int64], n_curves: int, absolute: bool
) -> tuple[NDArray[np.bool_], tuple[str, ...]]:
    """Which groups have a free scale, and notes about it for the user.

    A magnitude without a distance contains no information on the size of the body (``absolute`` is
    false).
    """
    used.add("calibrated")
    if "calibrated" not in table:
        free = np.full(n_curves, "curve" in table or not absolute)
        unknown = not absolute and "curve" not in table
        return free, (NO_RANGE,) if unknown else ()
    column = np.char.lower(table.texts["calibrated"])
    yes, no = np.isin(column, ("1", "true")), np.isin(column, ("0", "false"))
    table.reject("calibrated", ~(yes | no), "other than 0 or 1", "write 0 or 1")
    if not absolute:
        table.reject("calibrated", yes, "1 without range_km", RANGE)
    free = np.zeros(n_curves, bool)
    free[curve] = no
    table.reject("calibrated", no != free[curve], "differing within a curve", "give each curve one")
    return free, ()


NO_RANGE = "magnitudes without range_km are relative: they say nothing of the body's size"
RANGE = (
    "give the distance to which the magnitudes belong: of each row, or the one distance to which "
    "they were reduced"
)


def _check_flux(
    table: Table, flux: Floats, range_km: Floats | None, free: NDArray[np.bool_]
) -> tuple[str, ...]:
    """Reject impossible calibrated fluxes; return a note on the unit of fluxes without a range."""
    calibrated = flux[~free]
    if calibrated.size == 0:
        return ()
    with np.errstate(over="ignore"):
        level = float(np.median(calibrated))
    if range_km is None:
        return (
            "flux without range_km is taken as reduced to 1 m under unit sunlight (median "
            f"{level:.3g} m²): if the column holds counts, add a column calibrated with 0, and if "
            "it holds magnitudes, name it mag",
        )
    with np.errstate(over="ignore"):
        area = float(np.median(np.pi * calibrated * (1e3 * range_km[~free]) ** 2 / SOLAR_FLUX))
    if area > LARGEST_ALBEDO_AREA and np.median(range_km) < NEAR_KM:
        raise InputError(
            f"{table.file.name}: flux is {level:.3g} W/m² (median), for which a body would need "
            f"some {area:.1g} m²; if these are counts add a column calibrated with 0, if "
            "magnitudes name the column mag (--columns mag=flux)"
        )
    return ()


def _check_order(table: Table, t: Floats, curve: NDArray[np.int64], name: str) -> None:
    """Reject unsorted times, and repeated times unless the file declares them."""
    order = np.argsort(curve, kind="stable")
    before, after = order[:-1], order[1:]
    same = curve[before] == curve[after]
    back, again = np.zeros(t.size, bool), np.zeros(t.size, bool)
    back[after] = same & (t[after] < t[before])
    again[after] = same & (t[after] == t[before])
    table.reject(name, back, "earlier than the row before in the same curve", _SORT)
    if table.meta.get("repeated_times", ("",))[0] != "allowed":
        table.reject(name, again, "equal to the row before in the same curve", _REPEATS)


_SORT = "sort the rows by time"
_REPEATS = (
    "drop the repeats, or, if each is a measurement, add the line '# repeated_times: allowed' "
    "above the header"
)


def _geometry(
    table: Table, options: Options, t: Floats, epoch_jd: float | None, used: set[str]
) -> tuple[dict[str, Any], tuple[str, ...], dict[str, Any]]:
    """Directions to Sun and observer as fields of the light curve, notes, columns for `extra`.

    The file and the options must provide exactly one source of directions.
    """
    given = [
        what
        for what, here in (
            ("sun_x .. obs_z", any(name in table for name in VECTORS)),
            ("a TLE", options.tle is not None),
            ("ra_deg, dec_deg", any(name in table for name in RADEC[:2])),
            ("altitude_deg, azimuth_deg", any(name in table for name in ALTAZ)),
        )
        if here
    ]
    name = table.file.name
    if not given and options.brightness_only:
        unknown = np.full((t.size, 3), np.nan)
        frame = _declared_frame(table, used) or "inertial"
        ranges = table.numbers.get("range_km")
        used |= {"range_km"}
        return {"sun": unknown, "obs": unknown, "range_km": ranges, "frame": frame}, (), {}
    if len(given) > 1:
        raise InputError(
            f"{name} with its options gives the geometry more than once ({' and '.join(given)}), "
            "perhaps in different frames; keep one"
        )
    if not given:
        raise InputError(
            f"{name} has no geometry; expected sun_x sun_y sun_z obs_x obs_y obs_z, or a site with "
            "one of: --tle FILE, columns ra_deg dec_deg range_km, columns altitude_deg "
            "azimuth_deg height_km"
        )
    frame = _declared_frame(table, used)
    if given[0].startswith("sun"):
        need(table, VECTORS)
        if options.site is not None:
            raise InputError(f"{name} has directions of its own; leave out --site")
        used |= {*VECTORS, "range_km"}
        geometry = {name: _directions(table, name) for name in ("sun", "obs")}
        geometry |= {"range_km": table.numbers.get("range_km"), "frame": frame or "inertial"}
        return geometry | _given_orbit(table, used), (), {}
    if frame not in (None, "icrs"):
        raise InputError(
            f"{name} says its frame is {frame!r}, but directions computed from {given[0]} are in "
            "icrs; remove the frame, or give vectors"
        )
    if any(column in table for column in (*PLACE, *VELOCITY)):
        raise InputError(
            f"{name} has columns {PLACE[0]} …, and the satellite's place is computed from "
            f"{given[0]} as well; remove those columns"
        )
    seen, notes, extra = computed_geometry(table, options, t, epoch_jd, used)
    fields = ("sun", "obs", "range_km", "position_km", "velocity_km_s")
    return {name: getattr(seen, name) for name in fields} | {"frame": "icrs"}, notes, extra


def _given_orbit(table: Table, used: set[str]) -> dict[str, Floats]:
    """Position and velocity of the satellite, if the file contains them."""
    orbit = {}
    for field, names in (("position_km", PLACE), ("velocity_km_s", VELOCITY)):
        if any(name in table for name in names):
            need(table, names)
            used |= {*names}
            orbit[field] = np.stack([table.number(name) for name in names], axis=1)
    return orbit


def _declared_frame(table: Table, used: set[str]) -> str | None:
    """The frame named by a comment or a column; both must agree, in all rows."""
    said = table.meta["frame"][0].strip("'\"").lower() if "frame" in table.meta else None
    where = table.file.at(table.meta["frame"][1]) if said else ""
    if "frame" in table:
        used.add("frame")
        column = table.texts["frame"]
        said = said or str(column[0]).lower()
        where = where or table.at(0)
        mixed = np.char.lower(column) != said
        table.reject("frame", mixed, f"other than {said!r}, as {where} says", "use one frame")
    said = _SAME_AXES.get(said, said) if said else None
    if said is not None and said not in FRAMES:
        raise InputError(
            f"{where}: frame is {said!r}; expected one of: {', '.join(FRAMES)} (rotate the "
            "vectors of other frames first)"
        )
    return said


# axes that differ from ICRS by 0.02" or less
_SAME_AXES = {"gcrs": "icrs", "icrf": "icrs", "j2000": "icrs", "eme2000": "icrs"}


def _directions(table: Table, name: str) -> Floats:
    """Unit vectors from three columns of any length."""
    parts = [table.number(f"{name}_{axis}") for axis in "xyz"]
    vectors = np.stack(parts, axis=1)
    zero = ~np.any(vectors != 0, axis=1)
    table.reject(
        f"{name}_x .. {name}_z", zero, "with a direction of length zero", "drop those rows"
    )
    return unit(vectors)


def unit(vectors: Floats) -> Floats:
    """Unit vectors from (T, 3) vectors of any length except zero; unit vectors are unchanged."""
    size = np.max(np.abs(vectors), axis=1)
    with np.errstate(under="ignore"):
        scaled = vectors / size[:, None]  # so that squares do not over- or underflow
        length = np.linalg.norm(scaled, axis=1)
    keep = np.abs(length * np.minimum(size, 2.0) - 1.0) <= KEPT_UNIT
    return np.where(keep[:, None], vectors, scaled / length[:, None])
