"""CSV and ECSV in and out: what is read, what comes back, which spellings are harmless."""

import os
import subprocess
import sys
import tomllib
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from lcbayes.core.errors import InputError
from lcbayes.core.toml import to_toml
from lcbayes.data.lightcurve import LightCurve
from lcbayes.data.read import read, read_geometry
from lcbayes.data.write import write
from lcbayes.simulation.scenarios.scenario import load

HEADER = "t,flux,flux_err,sun_x,sun_y,sun_z,obs_x,obs_y,obs_z"
ROWS = ["0,1.5,0.1,2,0,0,0,3,0", "10,1.6,0.1,2,0,0,0,3,0", "20.5,1.4,0.2,0,0,-5,0.6,0.8,0"]
PLAIN = "\n".join([HEADER, *ROWS]) + "\n"


def read_text(folder, text, name="pass.csv", **options):
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read(path, **options)


def test_vectors_of_any_length(tmp_path):
    curve = read_text(tmp_path, PLAIN)
    assert curve.t.tolist() == [0.0, 10.0, 20.5]
    assert curve.brightness.tolist() == [1.5, 1.6, 1.4]
    assert curve.error is not None
    assert curve.error.tolist() == [0.1, 0.1, 0.2]
    assert curve.sun.tolist() == [[1, 0, 0], [1, 0, 0], [0, 0, -1]]
    assert curve.obs.tolist() == [[0, 1, 0], [0, 1, 0], [0.6, 0.8, 0]]
    assert (curve.kind, curve.frame, curve.epoch_jd) == ("flux", "inertial", None)
    assert not curve.free_scale.any()
    assert curve.source["format"] == "csv"
    assert len(curve.source["sha256"]) == 64


def test_vectors_of_extreme_length(tmp_path):
    rows = "t,mag,sun_x,sun_y,sun_z,obs_x,obs_y,obs_z\n0,1,3e-200,4e-200,0,3e200,0,4e200\n"
    curve = read_text(tmp_path, rows + "1,1,1e11,0,0,0,1,0\n")
    np.testing.assert_allclose(curve.sun[0], [0.6, 0.8, 0], rtol=1e-15)
    np.testing.assert_allclose(curve.obs[0], [0.6, 0, 0.8], rtol=1e-15)


HARMLESS = {
    "crlf": PLAIN.replace("\n", "\r\n"),
    "cr": PLAIN.replace("\n", "\r"),
    "tabs": PLAIN.replace(",", "\t"),
    "semicolons": PLAIN.replace(",", ";"),
    "spaces": PLAIN.replace(",", "  "),
    "padded": PLAIN.replace(",", " , "),
    "byte order mark": "\ufeff" + PLAIN,
    "comments": "# a comment\n\n" + PLAIN.replace("10,", "# between\n\n10,") + "\n\n",
    "quotes": PLAIN.replace("t,flux", '"t","flux"'),
    "quote in a comment": PLAIN.replace(",", " ").replace("10 ", '# "a\n10 '),
    "upper case": PLAIN.upper(),
    "no last line end": PLAIN.rstrip("\n"),
    "latin-1": ("# Teneriffa, Süd\n" + PLAIN).encode("latin-1"),
    "frame twice": "# frame: inertial\n# frame: inertial\n" + PLAIN,
}


@pytest.mark.parametrize("text", HARMLESS.values(), ids=HARMLESS.keys())
def test_harmless_spellings(tmp_path, text):
    plain, other = read_text(tmp_path, PLAIN), read_text(tmp_path, text, "other.csv")
    for field in ("t", "brightness", "error", "sun", "obs"):
        np.testing.assert_array_equal(getattr(other, field), getattr(plain, field))


def test_latin_1_is_noted(tmp_path):
    curve = read_text(tmp_path, ("# Süd\n" + PLAIN).encode("latin-1"))
    assert curve.source["notes"].startswith("read as Latin-1 (line 1 is not UTF-8)")


def test_columns_in_any_order_and_unknown_ones_kept(tmp_path):
    text = "note,obs_z,obs_y,obs_x,sun_z,sun_y,sun_x,mag,t,Seeing\n"
    text += '"a, b",0,0,1,0,1,0,7,0,1.50\nßé,0,0,1,0,1,0,8,1,x\n'
    curve = read_text(tmp_path, text)
    assert curve.kind == "mag"
    assert curve.error is None
    assert curve.extra["note"].tolist() == ["a, b", "ßé"]
    assert curve.extra["Seeing"].tolist() == ["1.50", "x"]
    write(curve, tmp_path / "again.csv")
    again = read(tmp_path / "again.csv")
    assert {k: v.tolist() for k, v in again.extra.items()} == {
        "note": ["a, b", "ßé"],
        "Seeing": ["1.50", "x"],
    }


def with_columns(**columns):
    """PLAIN with columns added."""
    lines = PLAIN.splitlines()
    for name, cells in columns.items():
        lines = [f"{line},{cell}" for line, cell in zip(lines, [name, *cells], strict=True)]
    return "\n".join(lines)


def test_curves_have_a_free_scale_unless_calibrated(tmp_path):
    curve = read_text(tmp_path, with_columns(curve=["b", "a", "b"]))
    assert curve.curve_names == ("b", "a")
    assert curve.curve.tolist() == [0, 1, 0]
    assert curve.free_scale.tolist() == [True, True]
    text = with_columns(curve=["b", "a", "b"], calibrated=["1", "false", "True"])
    assert read_text(tmp_path, text).free_scale.tolist() == [False, True]
    assert read_text(tmp_path, with_columns(calibrated="000")).free_scale.tolist() == [True]


def test_magnitudes_without_a_distance_are_relative(tmp_path):
    """They cannot say how large the body is: taken as if seen from 1 m, they once did."""
    text = PLAIN.replace("flux", "mag")
    curve = read_text(tmp_path, text)
    assert curve.free_scale.tolist() == [True]
    assert "without range_km are relative" in curve.source["notes"]
    assert read_text(tmp_path, with_columns(range_km="567")).free_scale.tolist() == [False]
    distant = with_columns(range_km="567").replace("flux", "mag")
    assert read_text(tmp_path, distant).free_scale.tolist() == [False]
    said = with_columns(calibrated="111").replace("flux", "mag")
    with pytest.raises(InputError, match=r"calibrated has 3 values 1 without range_km.*distance"):
        read_text(tmp_path, said)
    given = LightCurve(
        t=curve.t, brightness=curve.brightness, error=None, sun=curve.sun, obs=curve.obs, kind="mag"
    )
    assert given.free_scale.tolist() == [True]
    with pytest.raises(InputError, match="free_scale is False for magnitudes without range_km"):
        replace(given, free_scale=np.array([False]))


def test_band_site_exposure_range(tmp_path):
    text = with_columns(band="VVR", site=["A", "", "B"], exposure_s="012", range_km="567")
    curve = read_text(tmp_path, text)
    assert curve.band.tolist() == ["V", "V", "R"]
    assert curve.site.tolist() == ["A", "", "B"]
    assert curve.exposure_s.tolist() == [0, 1, 2]
    assert curve.range_km is not None
    assert curve.range_km.tolist() == [5, 6, 7]


def test_errors_by_option(tmp_path):
    def errors(text, **options):
        result = read_text(tmp_path, text, **options).error
        return None if result is None else result.tolist()

    bad = PLAIN.replace("1.6,0.1", "1.6,-1")
    assert errors(bad, error_floor=0.15) == [0.15, 0.15, 0.2]
    assert errors(bad, error=0.3) == [0.3, 0.3, 0.3]
    assert errors(bad, error=0.3, error_floor=0.5) == [0.5, 0.5, 0.5]
    with pytest.raises(InputError, match="not finite"):
        errors(PLAIN.replace("1.6,0.1", "1.6,nan"), error_floor=0.15)
    with pytest.raises(InputError, match=r"error is -1.* positive"):
        errors(PLAIN, error=-1.0)


@pytest.mark.parametrize(
    ("said", "frame"),
    [("icrs", "icrs"), ("GCRS", "icrs"), ("J2000", "icrs"), ("ecliptic-j2000", "ecliptic-j2000")],
)
def test_frames(tmp_path, said, frame):
    assert read_text(tmp_path, f"# frame: {said}\n{PLAIN}").frame == frame
    assert read_text(tmp_path, with_columns(frame=[said] * 3)).frame == frame


def timed(name, *cells):
    rows = (f"{cell},1,1,0,0,0,1,0" for cell in cells)
    return "\n".join([f"{name},mag,sun_x,sun_y,sun_z,obs_x,obs_y,obs_z", *rows])


def test_utc(tmp_path):
    """2024-04-29 is MJD 60429; 10:28:45.25 is 37725.25 s into it."""
    curve = read_text(
        tmp_path,
        timed("utc", "2024-04-29T10:28:45.25Z", "2024-04-29 10:28:46", "2024-04-30T00:00:00+00:00"),
    )
    assert curve.epoch_jd == 2460429.5
    assert curve.t.tolist() == [37725.25, 37726.0, 86400.0]


def test_utc_across_a_leap_second(tmp_path):
    cells = ("2016-12-31T23:59:59", "2016-12-31T23:59:60.5", "2017-01-01T00:00:00")
    curve = read_text(tmp_path, timed("utc", *cells))
    assert curve.t.tolist() == [86399.0, 86400.5, 86401.0]
    with pytest.raises(InputError, match="leap second that never was"):
        read_text(tmp_path, timed("utc", "2015-12-31T23:59:59", "2015-12-31T23:59:60"))


def test_utc_agrees_with_astropy(tmp_path):
    from astropy.time import Time

    cells = [
        f"{year}-03-0{day}T0{day}:11:12.125" for year in range(1973, 2025, 3) for day in (1, 5)
    ]
    curve = read_text(tmp_path, timed("utc", *cells))
    make: Any = Time  # its types do not know lists of text
    theirs = make(cells, scale="utc")
    assert curve.epoch_jd == Time("1973-03-01", scale="utc").jd
    np.testing.assert_allclose(
        curve.t, (theirs - Time("1973-03-01", scale="utc")).to_value("s"), atol=1e-5
    )


def test_jd(tmp_path):
    curve = read_text(tmp_path, timed("jd", "2460429.5", "2460430.25"))
    assert curve.epoch_jd == 2460429.0
    assert curve.t.tolist() == [43200.0, 108000.0]
    over = read_text(tmp_path, timed("jd", "2457754.25", "2457754.75"))  # 2016-12-31 18h .. 06h
    assert over.t.tolist() == [21600.0, 64801.0]


def test_seconds_with_an_epoch(tmp_path):
    curve = read_text(tmp_path, "# epoch_jd: 2460429.5\n" + PLAIN)
    assert curve.epoch_jd == 2460429.5


def test_repeated_times_can_be_meant(tmp_path):
    text = PLAIN.replace("10,1.6", "0,1.6")
    with pytest.raises(InputError, match="t has 1 value equal to"):
        read_text(tmp_path, text)
    curve = read_text(tmp_path, "# repeated_times: allowed\n" + text)
    assert curve.t.tolist() == [0, 0, 20.5]
    write(curve, tmp_path / "again.csv")
    assert read(tmp_path / "again.csv").t.tolist() == [0, 0, 20.5]


def test_geometry_alone(tmp_path):
    path = tmp_path / "epochs.csv"
    path.write_text("t,sun_x,sun_y,sun_z,obs_x,obs_y,obs_z\n5,1,0,0,0,1,0\n")
    curve = read_geometry(path)
    assert curve.geometry_only
    assert (curve.kind, curve.error, curve.n_obs) == ("mag", None, 1)
    path.write_text(PLAIN.replace("0.1", "-1"))
    assert read_geometry(path).kind == "flux"
    write(read_geometry(path), tmp_path / "again.csv")
    assert read_geometry(tmp_path / "again.csv").t.tolist() == [0, 10, 20.5]


def test_more_rows_than_one_chunk_keep_their_line_numbers(tmp_path, monkeypatch):
    monkeypatch.setattr("lcbayes.data.formats.table.CHUNK", 7)
    rows = [f"{i},1,0.1,1,0,0,0,1,0" for i in range(50)]
    assert read_text(tmp_path, "\n".join([HEADER, *rows])).t.tolist() == list(range(50))
    rows[30] = rows[30].replace("0.1", "zero")
    with pytest.raises(InputError, match="line 32, column 'flux_err' holds 'zero'"):
        read_text(tmp_path, "\n".join([HEADER, *rows]))
    rows[30] = rows[30].replace("zero", "0")
    with pytest.raises(InputError, match=r"flux_err has 1 value <= 0 \(first in .*, line 32: 0.0"):
        read_text(tmp_path, "\n".join([HEADER, *rows]))


def test_text_that_would_fill_the_memory_is_refused(tmp_path, monkeypatch):
    """Each cell of a column of text takes as much as its longest."""
    monkeypatch.setattr("lcbayes.data.formats.table.CHUNK", 7)
    monkeypatch.setattr("lcbayes.data.formats.table.MAX_TEXT", 4 * 50 * 40)
    rows = [f"{i},1,0.1,1,0,0,0,1,0,{'x' * (40 if i == 20 else 1)}" for i in range(50)]
    text = "\n".join([HEADER + ",note", *rows])
    assert read_text(tmp_path, text).extra["note"][20] == "x" * 40
    with pytest.raises(InputError, match=r"of up to 41 characters in each of 49 rows or more"):
        read_text(tmp_path, text.replace("x" * 40, "x" * 41) + "\n51,1,0.1,1,0,0,0,1,0,x")


def test_a_name_that_is_not_utf_8_is_escaped(tmp_path):
    """HDF5, TOML and CSV hold none of its bytes as they are."""
    path = tmp_path / os.fsdecode(b"caf\xe9.csv")
    path.write_text(PLAIN)
    source = read(path).source["file"]
    assert source == f"{tmp_path}/caf\\xe9.csv"
    assert tomllib.loads(to_toml({"curve": str(path)})) == {"curve": source}
    assert read(tmp_path.rename(tmp_path.with_name("é")) / path.name).source["file"].isprintable()


def test_what_is_no_text_is_not_read_to_its_end(tmp_path):
    path = tmp_path / "huge.csv"
    with path.open("wb") as file:
        file.truncate(1 << 40)  # takes no room on the disk
    with pytest.raises(InputError, match=r"huge\.csv has over 512 MiB"):
        read(path)
    for reader in (read, load):
        with pytest.raises(InputError, match="/dev/zero"):
            reader("/dev/zero")


def test_ecsv_of_quantities(tmp_path):
    """astropy writes an alias where columns share a unit."""
    from astropy import units
    from astropy.table import QTable

    columns: dict[str, Any] = {name: np.ones(2) for name in HEADER.split(",")[1:]}
    columns |= {"t": [1.0, 2.0] * units.s, "exposure_s": [0.1, 0.1] * units.s}
    path = tmp_path / "q.ecsv"
    QTable(columns, meta={"frame": "icrs", "remarks": {"a": [1]}}).write(path)
    assert "&id001" in path.read_text()
    assert read(path).frame == "icrs"


def test_ecsv_from_astropy(tmp_path):
    from astropy import units
    from astropy.table import Table

    table = Table(
        {
            "utc": ["2024-04-29T10:28:45", "2024-04-29T10:28:50"],
            "mag": [7.0, 7.5] * units.mag,
            "sun_x": [1.0, 0.0],
            "sun_y": [0.0, 1.0],
            "sun_z": [0.0, 0.0],
            "obs_x": [0.0, 0.0],
            "obs_y": [0.0, 0.0],
            "obs_z": [1.0, 1.0],
            "range_km": [800.0, 801.0] * units.km,
        },
        meta={"frame": "icrs"},
    )
    path = tmp_path / "a.ecsv"
    table.write(path)
    curve = read(path)
    assert (curve.frame, curve.kind, curve.source["format"]) == ("icrs", "mag", "ecsv")
    table["range_km"] = [800e3, 801e3] * units.m
    table.write(path, overwrite=True)
    with pytest.raises(InputError, match="'range_km' is in m; expected km: convert it"):
        read(path)


text_cells = st.text(
    st.characters(min_codepoint=32, max_codepoint=0x2FF, exclude_categories=("Cc", "Zs")),
    max_size=6,
)


@st.composite
def curves(draw):
    n = draw(st.integers(2, 6))
    numbers = st.floats(allow_nan=False, allow_infinity=False, width=64)
    positive = st.floats(1e-300, 1e300)
    column = lambda elements: draw(hnp.arrays(float, n, elements=elements))  # noqa: E731
    cells = lambda: np.array(draw(st.lists(text_cells, min_size=n, max_size=n)))  # noqa: E731
    angles = draw(hnp.arrays(float, (2, n, 2), elements=st.floats(-3, 3)))
    unit = np.stack(
        [
            np.cos(angles[..., 0]) * np.cos(angles[..., 1]),
            np.sin(angles[..., 0]) * np.cos(angles[..., 1]),
            np.sin(angles[..., 1]),
        ],
        axis=-1,
    )
    unit /= np.linalg.norm(unit, axis=-1, keepdims=True)
    n_curves = draw(st.integers(1, 2))
    kind = draw(st.sampled_from(["flux", "mag"]))
    range_km = draw(st.one_of(st.none(), st.just(column(positive))))
    magnitudes = kind == "mag"
    # readers refuse magnitudes that mark missing values, those that are all fluxes, and fluxes that
    # no body sends
    mags = st.floats(-30.0, 40.0).filter(lambda m: m == 0 or abs(m) >= 1e-3)
    free = draw(hnp.arrays(bool, n_curves)) | (magnitudes == (range_km is None))
    errors = st.floats(1e-300, 8.0) if magnitudes else positive
    return LightCurve(
        t=np.sort(column(numbers)),
        brightness=column(mags if magnitudes else numbers),
        error=draw(st.one_of(st.none(), st.just(column(errors)))),
        sun=unit[0],
        obs=unit[1],
        kind=kind,
        range_km=range_km,
        curve=np.arange(n) % n_curves,
        free_scale=free,
        curve_names=("first", "second one")[:n_curves],
        band=cells(),
        site=cells(),
        exposure_s=column(st.floats(0, 1e6)),
        epoch_jd=draw(st.one_of(st.none(), st.floats(2.4e6, 2.5e6))),
        frame=draw(st.sampled_from(["icrs", "ecliptic-j2000", "inertial"])),
        extra={"note": cells()},
    )


@settings(max_examples=60, deadline=None, derandomize=True)
@given(curves(), st.sampled_from(["csv", "ecsv"]))
def test_written_and_read_back_to_the_last_bit(tmp_path_factory, curve, suffix):
    path = tmp_path_factory.mktemp("round") / f"curve.{suffix}"
    write(curve, path)
    again = read(path)
    for field in ("t", "brightness", "error", "sun", "obs", "range_km", "curve", "free_scale"):
        mine, theirs = getattr(curve, field), getattr(again, field)
        assert (mine is None) == (theirs is None)
        if mine is not None:
            np.testing.assert_array_equal(theirs, mine)
    for field in ("band", "site", "exposure_s"):
        np.testing.assert_array_equal(getattr(again, field), getattr(curve, field))
    assert again.extra["note"].tolist() == curve.extra["note"].tolist()
    assert (again.epoch_jd, again.frame, again.kind) == (curve.epoch_jd, curve.frame, curve.kind)
    assert again.curve_names == curve.curve_names


def test_writing_fails_without_a_trace(tmp_path, monkeypatch):
    curve = read_text(tmp_path, PLAIN)
    with pytest.raises(InputError, match="cannot be written"):
        write(curve, tmp_path / "absent" / "out.csv")
    with pytest.raises(InputError, match="is a folder"):
        write(curve, tmp_path)
    (tmp_path / "out.csv").write_text("before")

    def fail(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.replace", fail)
    with pytest.raises(InputError, match="No space left"):
        write(curve, tmp_path / "out.csv")
    assert (tmp_path / "out.csv").read_text() == "before"
    assert sorted(x.name for x in tmp_path.iterdir()) == ["out.csv", "pass.csv"]


def test_extra_columns_may_not_pose_as_others(tmp_path):
    curve = read_text(tmp_path, PLAIN)
    for name in ("mag", "UTC"):
        posing = LightCurve(
            t=curve.t,
            brightness=curve.brightness,
            error=None,
            sun=curve.sun,
            obs=curve.obs,
            extra={name: curve.t},
        )
        with pytest.raises(InputError, match="rename it"):
            write(posing, tmp_path / "out.csv")


def test_reading_vectors_needs_neither_astropy_nor_jax():
    script = (
        "import sys, lcbayes.data; print({'jax', 'astropy', 'sgp4', 'erfa'} & set(sys.modules))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "set()"
