"""Columns with other names: mapped by the user, or recognised.

A note lists the recognised columns. A column that looks like an error is never ignored silently: it
is recognised, or the file is rejected.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from lcbayes.core.errors import InputError
from lcbayes.core.files import TextFile
from lcbayes.data.formats.columns import BRIGHTNESS, KNOWN, TIMES

IGNORE = "ignore"  # in place of an lcbayes name: the column is ignored
# Common names in lower case, with other characters than letters and digits as one underscore.
ALIASES: dict[str, tuple[str, ...]] = {
    "utc": (
        "date_time_utc", "datetime_utc", "utc_datetime", "date_time", "datetime", "date_utc",
        "time_utc", "utc_time", "timestamp", "timestamp_utc", "date_obs", "dateobs", "obs_time",
        "observation_time", "observation_time_utc", "isot", "iso_time", "epoch_utc",
    ),
    "jd": ("jd_utc", "julian_date", "jd_mid", "bjd_utc"),
    "mjd": ("mjd_utc", "modified_julian_date", "mjd_mid"),
    "t": ("t_s", "time_s", "seconds", "elapsed_s", "time_sec", "t_sec"),
    "date": ("date_ut", "day"),
    "clock": ("time", "ut", "ut_time", "time_ut", "hour", "utc_clock"),
    "mag": (
        "magnitude", "apparent_magnitude", "app_mag", "vmag", "v_mag", "mag_v", "gmag", "g_mag",
        "instmag", "inst_mag", "instrumental_magnitude", "mag_auto",
    ),
    "flux": ("flux_w_m2", "brightness_flux", "irradiance", "intensity"),
    "mag_err": (
        "magerr", "mag_error", "magerror", "e_mag", "err_mag", "mag_unc", "mag_uncertainty",
        "mag_sigma", "sigma_mag", "mag_sd", "dmag", "magnitude_error", "magnitude_uncertainty",
        "apparent_magnitude_uncertainty", "magerr_auto",
    ),
    "flux_err": (
        "fluxerr", "flux_error", "fluxerror", "e_flux", "err_flux", "flux_unc", "flux_uncertainty",
        "flux_sigma", "sigma_flux", "flux_sd", "dflux", "intensity_error",
    ),
    "band": ("filter", "passband"),
    "site": ("observatory", "station", "site_name"),
    "range_km": ("range", "distance_km", "slant_range_km"),
    "exposure_s": ("exposure", "exptime", "exp_s", "exposure_time_s"),
    "ra_deg": ("ra", "ra_j2000_deg", "right_ascension_deg"),
    "dec_deg": ("dec", "decl_deg", "dec_j2000_deg", "declination_deg"),
}  # fmt: skip
# Names of the error of either kind of brightness.
ERRORS = (
    "err",
    "error",
    "uncertainty",
    "uncert",
    "unc",
    "sigma",
    "sd",
    "std",
    "stdev",
    "stddev",
    "e",
    "rms",
)
_ERROR_LIKE = re.compile(
    r"err(or)?s?(_|$)"
    r"|(^|_)(uncertainty|uncert|unc|sigma|sig|sd|se|sem|std|stdev|stddev|rms|noise|precision)(_|$)"
    r"|^(e|d|s)_?(mag|magnitude|flux)$|^(e|d|sig)_?[ubvrigcw]$|^e_[zy]$|plus_minus"
)  # but not ey and ez, which may be directions
MOST_NAMED = 8  # columns that are not read
_PLUS_MINUS = re.compile(r"±|\+/?-")
_MAPPED = re.compile(r'\s*(\w+)\s*=\s*(?:"([^"]*)"|([^,"]+))\s*')
_PAIRS = re.compile(f"{_MAPPED.pattern}(,{_MAPPED.pattern})*")


def mapping_of(columns: str | Mapping[str, str] | None) -> dict[str, str]:
    """lcbayes name → file's name, from ``mag=V,mag_err=err,utc="Date/Time (UTC)"`` or a mapping.

    Raises
    ------
    InputError
        A pair is malformed or names an unknown column.
    """
    if columns is None:
        return {}
    if isinstance(columns, str):
        if not _PAIRS.fullmatch(columns):
            raise InputError(f"--columns is {columns!r}; expected pairs such as mag=V,mag_err=err")
        columns = {m[1]: (m[2] or m[3]).strip() for m in _MAPPED.finditer(columns)}
    unknown = [name for name in columns if name not in KNOWN and name != IGNORE]
    if unknown:
        name, label = unknown[0], columns[unknown[0]]
        if label in KNOWN:
            raise InputError(
                f"--columns has {name}={label}; the lcbayes name comes first: {label}={name}"
            )
        raise InputError(
            f"--columns names {unknown[0]!r}; available: {', '.join((*KNOWN, IGNORE))}"
        )
    return dict(columns)


def renamed(
    file: TextFile, labels: Sequence[str], asked: Mapping[str, str], *, brightness: bool = True
) -> tuple[dict[str, str], tuple[str, ...]]:
    """Name in the file → lcbayes name, and a note on the recognised columns.

    Parameters
    ----------
    labels : names of the columns in the file
    asked : lcbayes name → name in the file, from the user
    brightness : whether the brightness is read; if not, errors are ignored

    Raises
    ------
    InputError
        A column named by the user is missing, two columns could have the same meaning, or a column
        looks like an error but cannot be matched.
    """
    rename: dict[str, str] = {}
    for name, label in asked.items():
        if label not in labels:
            raise InputError(
                f"{file.name} has no column {label!r}, which --columns names for {name}; it has: "
                f"{', '.join(labels[:12])}"
            )
        rename[label] = f"{IGNORE}:{label}" if name == IGNORE else name
    simple = {label: _simple(label) for label in labels}
    present = {simple[label] for label in labels} | set(rename.values())
    notes = []
    for name in _missing(present):
        similar = [
            label for label in labels if label not in rename and simple[label] in ALIASES[name]
        ]
        if len(similar) > 1:
            raise InputError(
                f"{file.name} has {' and '.join(map(repr, similar))}, each of which could be "
                f"{name}; say which: --columns {name}={similar[0]!r}"
            )
        if similar:
            rename[similar[0]] = name
            present |= {name}
            notes.append(f"column {similar[0]!r} was taken for {name}")
    if brightness:
        notes += _errors(file, labels, simple, rename, present)
    return rename, tuple(notes)


def _simple(label: str) -> str:
    return re.sub(r"[^a-z0-9]+", "_", label.lower()).strip("_")


def _missing(present: set[str]) -> list[str]:
    """lcbayes names that are missing from the file and may be present under another name."""
    times = bool(present & {*TIMES, "mjd"})
    kinds = present & set(BRIGHTNESS)
    left = []
    for name in ALIASES:
        has = name in present
        if name in (*TIMES, "mjd", "date", "clock"):
            has = has or times
        if name in BRIGHTNESS:
            has = has or bool(kinds)
        if not has:
            left.append(name)
    return left


def _errors(
    file: TextFile,
    labels: Sequence[str],
    simple: Mapping[str, str],
    rename: dict[str, str],
    present: set[str],
) -> list[str]:
    """Use the only column that looks like an error, or reject the file."""
    kind = next((name for name in BRIGHTNESS if name in present), None)
    known = {_simple(name) for name in KNOWN}
    error_like = [
        label
        for label in labels
        if label not in rename
        and (
            _PLUS_MINUS.search(label)
            or (
                simple[label] not in known
                and (simple[label] in ERRORS or _ERROR_LIKE.search(simple[label]))
            )
        )
    ]
    if kind is None:
        return []
    error = f"{kind}_err"
    if not error_like:
        others = [x for x in labels if x not in rename and simple[x] not in known]
        if error in present or not others:
            return []
        return [
            f"not read: {', '.join(map(repr, others[:MOST_NAMED]))}; if one is the error, say so: "
            f"--columns {error}={others[0]!r}"
        ]
    if error in present:
        return [f"column {label!r} is left aside: {error} is the error" for label in error_like]
    if len(error_like) == 1 and simple[error_like[0]] in ERRORS:
        rename[error_like[0]] = error
        return [f"column {error_like[0]!r} was taken for {error}"]
    raise InputError(
        f"{file.name}: column {error_like[0]!r} looks like an error; say what it is: "
        f"--columns {error}={error_like[0]!r}, or --columns {IGNORE}={error_like[0]!r}"
    )
