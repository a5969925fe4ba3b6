"""Damaged files: each gives exit 2, one line naming file, line and remedy, and nothing written."""

from __future__ import annotations

import random
from dataclasses import dataclass
from pathlib import Path

import pytest

from lcbayes.cli.main import main
from lcbayes.core.errors import EXIT_BAD_INPUT, InputError
from lcbayes.data.read import read

HEADER = "t,flux,flux_err,sun_x,sun_y,sun_z,obs_x,obs_y,obs_z"
ROW = "{},1.5,0.1,1,0,0,0,1,0"
PLAIN = "\n".join([HEADER, *(ROW.format(10 * i) for i in range(6))]) + "\n"
UTC = (
    "utc,mag,ra_deg,dec_deg,range_km,site_lat_deg,site_lon_deg,site_height_m\n"
    "2024-04-29T10:28:45Z,2.4,296.558,2.64,409.0,36.128,-95.988,201\n"
    "2024-04-29T10:30:27Z,2.3,294.895,4.36,400.3,36.128,-95.988,201\n"
)
ALTAZ = (
    "utc,mag,altitude_deg,azimuth_deg,height_km\n"
    "2022-01-25T12:53:02,7.8,23.1,45.8,543.3\n2022-01-25T12:54:02,7.9,25.1,46.8,543.3\n"
)
ALTAZ_SITE = ("--site", "32.4434,-110.7881,2790")
DAMIT = (
    "2\n2 0\n2443845.25 2.0 0 -2 0 3 0 0\n2443845.75 4.0 0 -2 0 3 0 0\n"
    "2 1\n2443846.5 7.5 0 0 1 0 4 3\n2443846.6 7.6 0 0 1 0 4 3\n"
)
TLE = (
    "1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927\n"
    "2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537\n"
)
TIMES = "utc,mag\n2008-09-20T15:14:40Z,7\n2008-09-20T15:15:00Z,7\n"
PASS = ("--tle", "{folder}/object.tle", "--site", "43.65,41.431,2030")
MMT9 = (
    "# Date Time StdMag Mag Filter Penumbra Distance Phase Channel Track\n"
    "2008-09-20 15:14:40 6.1 7.1 Clear 0 1500 60 4 777\n"
    "2008-09-20 15:15:00 6.1 7.1 Clear 0 1500 60 4 777\n"
)
ECSV = (
    "# %ECSV 1.0\n# ---\n# datatype:\n# - {name: t, datatype: float64}\n"
    "# - {name: flux, datatype: float64}\nt flux\n1 2\n2 3\n"
)

BOMB = (
    "a0: &a0 [x,x,x,x,x,x,x,x,x,x]\n"
    + "".join(f"# a{i}: &a{i} [{','.join([f'*a{i - 1}'] * 10)}]\n" for i in range(1, 10))
    + "# "
)


@dataclass(frozen=True)
class Case:
    """A damaged file, what the message must contain, and how the file is read."""

    content: str | bytes
    says: tuple[str, ...]
    line: int | None = None
    options: tuple[str, ...] = ()
    name: str = "pass.csv"
    tle: str = TLE
    blamed: str = ""  # what the message names, when it is not the light curve


def swap(old: str, new: str, text: str = PLAIN) -> str:
    """`text` with `old`, which must be there, replaced once."""
    assert old in text
    return text.replace(old, new, 1)


def row(i: int, new: str) -> str:
    """PLAIN with its row i (from 0) replaced; that row stands on line i + 2."""
    return swap(ROW.format(10 * i), new)


def column(name: str, cells: list[str], text: str = PLAIN) -> str:
    """`text` with a column added."""
    lines = text.splitlines()
    return "\n".join(f"{a},{b}" for a, b in zip(lines, [name, *cells], strict=True)) + "\n"


CASES = {
    # the file itself
    "empty": Case(b"", ("is empty", "give another")),
    "blank": Case(" \n\t\n", ("is empty",)),
    "binary": Case(bytes(range(256)) * 4, ("not text", "export it as CSV"), 1),
    "image": Case(b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", ("binary",), 2),
    "null byte in a row": Case(row(2, "20,1.5\0,0.1,1,0,0,0,1,0"), ("0x00", "not text"), 4),
    "utf-16": Case(PLAIN.encode("utf-16"), ("UTF-16", "save it as UTF-8")),
    "broken utf-8": Case(b"# \x81\x9f\n" + PLAIN.encode(), ("neither UTF-8",), 1),
    "latin-1 minus in a number": Case(
        row(1, "10,\xad1.5,0.1,1,0,0,0,1,0").encode("latin-1"), ("'flux'", "expected a number"), 3
    ),
    # header and layout
    "only comments": Case("# t,flux\n# nothing\n", ("only comments", "expected a header")),
    "only a header": Case(HEADER + "\n", ("no rows", "one row per point")),
    "no header": Case(PLAIN.split("\n", 1)[1], ("names of columns", "add a header"), 1),
    "ragged row": Case(row(3, ROW.format(30) + ",7"), ("10 comma-separated", "names 9"), 5),
    "short row": Case(row(3, "30,1.5"), ("2 comma-separated cells", "correct the row"), 5),
    "cut in mid-row": Case(PLAIN[:-12], ("comma-separated cells",), 7),
    "column twice": Case(swap("flux_err", "flux"), ("'flux' names both column 2 and", "3"), 1),
    "column twice but for case": Case(swap("flux_err", "FLUX"), ("names both", "rename"), 1),
    "a column more than is read": Case(
        swap(HEADER, HEADER + "".join(f",c{i}" for i in range(60_000))),
        ("60009 columns; at most 1000",),
        1,
    ),
    "a long note": Case(
        column("note", ["a", "a", "x" * 1001, "a", "a", "a"]),
        ("column 'note' holds a cell of 1001 characters; at most 1000",),
        4,
    ),
    "a number of many digits": Case(
        row(2, f"20,{'1' * 5000}x,0.1,1,0,0,0,1,0"), ("column 'flux' holds a cell of 5001",), 4
    ),
    "a comment of spaces": Case("# a: x" + " " * 200_000 + "y\n" + row(2, "20"), ("1 comma",), 5),
    "column without name": Case(swap("flux_err", ""), ("column 3 has no name", "remove it"), 1),
    "quote not closed": Case(row(2, '20,"1.5,0.1,1,0,0,0,1,0'), ("close the quotes",), 4),
    "text after a quote": Case(row(2, '20,"1.5"x,0.1,1,0,0,0,1,0'), ("quotes",), 4),
    "quote not closed in the header": Case(swap("t,", '"t,'), ("close the quotes",), 1),
    "other delimiter below": Case(
        PLAIN.split("\n")[0] + "\n" + PLAIN.split("\n", 1)[1].replace(",", "\t"), ("1 comma",), 2
    ),
    "tab inside commas": Case(row(1, "10\t1.5,0.1,1,0,0,0,1,0"), ("8 comma", "names 9"), 3),
    "decimal commas": Case(PLAIN.replace("1.5", '"1,5"'), ("'1,5'", "use a decimal point"), 2),
    "lone carriage returns in a row": Case(row(1, ROW.format(10).replace(",1", "\r,1", 1)), (), 3),
    # columns that are missing or too many
    "no time": Case(swap("t,flux,", "time,flux,"), ("no column of times", "utc, jd, mjd, t")),
    "two times": Case(column("jd", ["2460000.5"] * 6), ("time more than once", "keep one")),
    "no brightness": Case(swap("flux,", "counts,"), ("no column of brightness", "flux or mag")),
    "two brightnesses": Case(column("mag", ["7"] * 6), ("brightness more than once",)),
    "error of the other unit": Case(swap("flux_err", "mag_err"), ("expected flux_err",)),
    "one axis missing": Case(swap("obs_z", "obs_w"), ("no column obs_z", "expected all of")),
    "no geometry": Case(TIMES, ("no geometry", "--tle FILE")),
    "two geometries": Case(
        column("ra_deg", ["1"] * 6), ("geometry more than once", "frames", "keep one")
    ),
    # numbers
    "text for a number": Case(row(2, "20,bright,0.1,1,0,0,0,1,0"), ("'flux' holds 'bright'",), 4),
    "empty cell": Case(row(2, "20,,0.1,1,0,0,0,1,0"), ("'flux' is empty", "drop the row"), 4),
    "underscore in a number": Case(row(2, "20,1_5,0.1,1,0,0,0,1,0"), ("'1_5'", "a number"), 4),
    "exotic digits": Case(row(2, "20,١٥,0.1,1,0,0,0,1,0"), ("expected a number",), 4),
    "nan flux": Case(row(2, "20,nan,0.1,1,0,0,0,1,0"), ("flux has 1 value not finite", "drop"), 4),
    "infinite flux": Case(row(5, "50,-inf,0.1,1,0,0,0,1,0"), ("flux has 1", "not finite"), 7),
    "overflowing flux": Case(row(5, "50,1e999,0.1,1,0,0,0,1,0"), ("not finite",), 7),
    "nan time": Case(row(0, ROW.format("nan")), ("t has 1 value not finite",), 2),
    "negative errors": Case(
        PLAIN.replace("0.1", "-0.1"), ("flux_err has 6 values <= 0", "--error-floor"), 2
    ),
    "zero error": Case(row(4, "40,1.5,0,1,0,0,0,1,0"), ("flux_err has 1 value <= 0",), 6),
    "nan error": Case(row(4, "40,1.5,nan,1,0,0,0,1,0"), ("flux_err has 1", "not finite"), 6),
    "negative exposure": Case(column("exposure_s", ["-1"] * 6), ("exposure_s has 6", "< 0"), 2),
    "range zero": Case(column("range_km", ["0"] * 6), ("range_km has 6", "km"), 2),
    # order
    "unsorted": Case(row(2, ROW.format(5)), ("t has 1 value earlier", "sort the rows"), 4),
    "repeated time": Case(row(2, ROW.format(10)), ("t has 1 value equal to", "drop"), 4),
    "repeated row": Case(PLAIN + ROW.format(50) + "\n", ("equal to the row before",), 8),
    "unsorted in one curve": Case(
        column("curve", list("ababab"), row(4, ROW.format(15))), ("t has 1 value earlier",), 6
    ),
    "one point": Case(f"{HEADER}\n{ROW.format(0)}\n", ("holds one point", "at least two")),
    # directions and frames
    "sun of length zero": Case(row(1, "10,1,0.1,0,0,0,0,1,0"), ("sun_x", "length zero"), 3),
    "observer of length zero": Case(row(1, "10,1,0.1,1,0,0,0,0,0"), ("obs_x", "drop"), 3),
    "nan in a vector": Case(row(1, "10,1,0.1,1,0,nan,0,0,1"), ("sun_z has 1", "not finite"), 3),
    "two frames": Case(
        "# frame: icrs\n# frame: ecliptic-j2000\n" + PLAIN, ("line 1 says 'icrs'", "give one"), 2
    ),
    "frame changes": Case(
        column("frame", ["icrs"] * 3 + ["inertial"] * 3), ("frame has 3", "use one frame"), 5
    ),
    "frame unknown": Case("# frame: teme\n" + PLAIN, ("'teme'", "expected one of: icrs"), 1),
    "frame of the file not that of the sky": Case(
        "# frame: ecliptic-j2000\n" + UTC, ("'ecliptic-j2000'", "are in icrs", "remove the frame")
    ),
    # curves
    "curve without name": Case(column("curve", list("aab") + [""] * 3), ("curve has 3",), 5),
    "calibrated perhaps": Case(column("calibrated", ["maybe"] * 6), ("write 0 or 1",), 2),
    "calibrated in part": Case(column("calibrated", list("111110")), ("differing within",), 2),
    # dates
    "not a date": Case(swap("2024-04-29T10:30", "29.4.2024 10:30", UTC), ("ISO 8601",), 3),
    "13th month": Case(swap("2024-04-29T10:30", "2024-13-29T10:30", UTC), ("calendar",), 3),
    "February 30": Case(swap("2024-04-29T10:30", "2024-02-30T10:30", UTC), ("calendar",), 3),
    "25 o'clock": Case(swap("T10:30", "T25:30", UTC), ("ISO 8601", "write them like"), 3),
    "local time": Case(swap("10:30:27Z", "10:30:27CEST", UTC), ("ISO 8601, UTC",), 3),
    "year 3024": Case(swap("2024-04-29T10:30", "3024-04-29T10:30", UTC), ("1900 .. 2100",), 3),
    "false leap second": Case(swap("10:30:27Z", "23:59:60Z", UTC), ("leap second",), 3),
    "modified Julian date": Case(
        PLAIN.replace("t,", "jd,").replace("\n", "\n6042")[:-4], ("jd has", "2400000.5"), 2
    ),
    "epoch not a number": Case("# epoch_jd: today\n" + PLAIN, ("expected a Julian date",), 1),
    "epoch of a modified Julian date": Case(
        "# epoch_jd: 60429\n" + PLAIN, ("epoch_jd is '60429'", "MJD + 2400000.5"), 1
    ),
    "seconds without a date": Case(
        UTC.replace("utc", "t")
        .replace("2024-04-29T10:28:45Z", "0")
        .replace("2024-04-29T10:30:27Z", "102"),
        ("without a date", "epoch_jd"),
    ),
    # sites and sky
    "no site": Case(ALTAZ, ("names no site", "--site LAT,LON,H")),
    "two sites": Case(UTC, ("keep one",), None, ("--site", "1,2,3")),
    "site in words": Case(ALTAZ, ("43.65,41.431,2030",), None, ("--site", "Paris"), blamed="site"),
    "latitude out of range": Case(
        UTC.replace("36.128", "96.128"), ("site_lat_deg", "outside -90 .. 90", "degrees"), 2
    ),
    "site without height": Case(UTC.replace("site_height_m", "h"), ("no column site_height_m",)),
    "declination out of range": Case(swap("4.36", "94.36", UTC), ("dec_deg", "-90 .. 90"), 3),
    "below the horizon": Case(swap("4.36", "-84.36", UTC), ("below the horizon", "check"), 3),
    "altitude negative": Case(swap("25.1", "-25.1", ALTAZ), ("altitude_deg has 1",), 3, ALTAZ_SITE),
    "height in metres": Case(swap("543.3", "5433000", ALTAZ), ("height_km",), 2, ALTAZ_SITE),
    "height under the site": Case(swap("543.3", "1.5", ALTAZ), ("height_km",), 2, ALTAZ_SITE),
    # elements
    "wrong checksum": Case(
        TIMES,
        ("checksum is 6", "copy"),
        1,
        PASS,
        tle=swap("2927", "2926", TLE),
        blamed="object.tle",
    ),
    "second line of elements missing": Case(
        TIMES,
        ("line 2 of the elements is missing",),
        1,
        PASS,
        tle=TLE.split("\n")[0],
        blamed="object.tle",
    ),
    "no elements": Case(
        TIMES, ("no two-line elements",), None, PASS, tle=PLAIN, blamed="object.tle"
    ),
    "empty elements": Case(TIMES, ("is empty",), None, PASS, tle="", blamed="object.tle"),
    "elements long out of date": Case(
        TIMES.replace("2008-09", "2018-09"), ("days from", "get elements within 30"), 2, PASS
    ),
    "elements of another object": Case(
        TIMES.replace("T15", "T16"), ("below the horizon", "of this object"), 2, PASS
    ),
    # DAMIT
    "lcs of 2 GB in one curve": Case(
        swap("2 0", "2147483647 0", DAMIT), ("2147483647 points", "only 5 lines"), 2, name="a.lcs"
    ),
    "lcs of 2 GB in curves": Case(
        "2147483647" + DAMIT[1:], ("2147483647 curves", "holds 2"), 1, name="a.lcs"
    ),
    "lcs count beyond any integer": Case(
        swap("2 0", "9" * 400 + " 0", DAMIT), ("npoints flag",), 2, name="a.lcs"
    ),
    "lcs cut": Case(DAMIT[:-30], ("2 points are announced", "cut short"), 5, name="a.lcs"),
    "lcs cut in mid-row": Case(DAMIT[:-6], ("a row has 8",), 7, name="a.lcs"),
    "lcs count too small": Case(swap("2 0", "1 0", DAMIT), ("npoints",), 4, name="a.lcs"),
    "lcs count too large": Case(swap("2 0", "3 0", DAMIT), ("2 cells where",), 5, name="a.lcs"),
    "lcs negative count": Case(swap("2 0", "-2 0", DAMIT), ("npoints",), 2, name="a.lcs"),
    "lcs flag 7": Case(swap("2 0", "2 7", DAMIT), ("flag 0 or 1",), 2, name="a.lcs"),
    "lcs text": Case(swap("4.0", "four", DAMIT), ("'four'", "give numbers"), 4, name="a.lcs"),
    "lcs nan": Case(swap("4.0", "nan", DAMIT), ("not finite", "drop"), 4, name="a.lcs"),
    "lcs dark": Case(swap("4.0", "-4.0", DAMIT), ("not positive", "drop"), 4, name="a.lcs"),
    "lcs vector zero": Case(swap("0 -2 0", "0 0 0", DAMIT), ("length zero",), 3, name="a.lcs"),
    "lcs unsorted": Case(swap("845.75", "844.75", DAMIT), ("earlier than",), 4, name="a.lcs"),
    "lcs without curves": Case("0\n", ("number of curves",), 1, name="a.lcs"),
    # MMT-9, SCORE, ECSV
    "mmt-9 without elements": Case(MMT9, ("no directions", "--tle FILE"), name="a.txt"),
    "mmt-9 columns missing": Case(
        MMT9.replace(" Phase", ""), ("lacks the MMT-9 columns Phase",), None, PASS[:2], "a.txt"
    ),
    "mmt-9 row short": Case(swap(" 4 777\n", "\n", MMT9), ("8 space",), 2, PASS[:2], "a.txt"),
    "mmt-9 of another object": Case(MMT9, ("contradict",), 2, PASS[:2], "a.txt"),
    "mmt-9 in penumbra": Case(
        MMT9.replace(" 0 1500", " 1 1500"), ("penumbra", "nothing is left"), None, PASS[:2], "a.txt"
    ),
    "directions and a site": Case(PLAIN, ("leave out --site",), None, ALTAZ_SITE),
    "all in the Earth's shadow": Case(
        TIMES.replace("T15:14:40", "T00:20:40").replace("T15:15:00", "T00:21:00"),
        ("all 2 points lie in the Earth's shadow", "check"),
        None,
        PASS,
    ),
    "score without places": Case(
        "satellite_name,observation_time_utc,apparent_magnitude\nA,2024-04-29T10:28:45Z,2\n"
        "A,2024-04-29T10:28:46Z,2\n",
        ("no geometry",),
    ),
    "ecsv header not yaml": Case(
        swap("datatype:\n", "datatype: [\n", ECSV), ("header cannot be read (ParserError",), 1
    ),
    "ecsv header and names differ": Case(swap("t flux", "t mag", ECSV), ("differ (flux, mag)",), 6),
    "ecsv with aliases of aliases": Case(
        swap("datatype:", f"{BOMB}meta: {{k: *a9}}\n# datatype:", ECSV),
        ("its aliases stand for too much",),
        1,
    ),
    "ecsv that holds itself": Case(
        swap("datatype:", "x: &x [*x]\n# datatype:", ECSV), ("aliases stand for too much",), 1
    ),
    "ecsv with a number for a delimiter": Case(
        swap("datatype:", "delimiter: 5\n# datatype:", ECSV), ("neither a space nor a comma",), 1
    ),
    "ecsv with another delimiter": Case(
        swap("datatype:", "delimiter: '|'\n# datatype:", ECSV) + "1|2\n", ("nor a comma",), 1
    ),
    "ecsv with a list for a meta": Case(
        swap("datatype:", "meta: [1, 2]\n# datatype:", ECSV), ("its meta has no keys",), 1
    ),
    "ecsv with a text for a meta": Case(
        swap("datatype:", "meta: hello\n# datatype:", ECSV), ("its meta has no keys",), 1
    ),
    "ecsv with a list for a frame": Case(
        swap("datatype:", "meta: {frame: [icrs]}\n# datatype:", ECSV), ("frame in its meta",), 1
    ),
    "ecsv in other units": Case(
        swap("{name: t,", "{name: t, unit: h,", ECSV), ("'t' is in h; expected s",)
    ),
}


def run_cli(argv: list[str]) -> int:
    """`lcbayes` in this process."""
    return main(argv)


def convert_fails(folder: Path, path: Path, options: tuple[str, ...], capsys) -> str:
    """Convert, check that it fails as it should, and return the message."""
    before = {x: x.stat().st_mtime_ns for x in folder.rglob("*")}
    options = tuple(option.format(folder=folder) for option in options)
    code = run_cli(["convert", str(path), str(folder / "out.csv"), *options])
    out, err = capsys.readouterr()
    assert code == EXIT_BAD_INPUT
    assert out == ""
    assert err.endswith("\n")
    assert err.count("\n") == 1, err
    assert "Traceback" not in err
    assert {x: x.stat().st_mtime_ns for x in folder.rglob("*")} == before
    return err


def test_there_are_enough():
    assert len(CASES) >= 40


@pytest.mark.parametrize("case", CASES.values(), ids=CASES.keys())
def test_damaged(case, tmp_path, capsys):
    path = tmp_path / case.name
    content = case.content
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    (tmp_path / "object.tle").write_text(case.tle)
    err = convert_fails(tmp_path, path, case.options, capsys)
    where = case.blamed or case.name
    assert (where if case.line is None else f"{where}, line {case.line}") in err
    for words in case.says:
        assert words in err


def test_missing(tmp_path, capsys):
    err = convert_fails(tmp_path, tmp_path / "absent.csv", (), capsys)
    assert "absent.csv does not exist; check the path" in err


def test_folder(tmp_path, capsys):
    (tmp_path / "folder.csv").mkdir()
    assert "is a folder; give a file, or" in convert_fails(
        tmp_path, tmp_path / "folder.csv", (), capsys
    )


def test_unreadable(tmp_path, capsys, monkeypatch):
    """Rights do not bind the superuser, whom tests may run as: so the system's answer is played."""
    path = tmp_path / "pass.csv"
    path.write_text(PLAIN)

    def refuse(self, *_):
        raise PermissionError(13, "Permission denied", str(self))

    monkeypatch.setattr(Path, "open", refuse)
    err = convert_fails(tmp_path, path, (), capsys)
    assert "pass.csv cannot be read (Permission denied); check its rights" in err


def test_elements_file_missing(tmp_path, capsys):
    path = tmp_path / "pass.csv"
    path.write_text(TIMES)
    assert "object.tle does not exist" in convert_fails(tmp_path, path, PASS, capsys)


@pytest.mark.parametrize(
    ("out", "says"),
    [
        ("out.xlsx", "ending in .csv or .ecsv"),
        ("pass.csv", "OUT is the input"),
        ("absent/out.csv", "cannot be written"),
    ],
)
def test_output_at_fault(out, says, tmp_path, capsys):
    path = tmp_path / "pass.csv"
    path.write_text(PLAIN)
    assert run_cli(["convert", str(path), str(tmp_path / out)]) == EXIT_BAD_INPUT
    assert says in capsys.readouterr().err
    assert path.read_text() == PLAIN
    assert list(tmp_path.iterdir()) == [path]


def test_what_is_not_damaged_is_converted(tmp_path, capsys):
    """The texts that the cases above damage are sound themselves."""
    (tmp_path / "object.tle").write_text(TLE)
    for name, text, options in (
        ("a.csv", PLAIN, ()),
        ("b.csv", UTC, ()),
        ("c.csv", ALTAZ, ALTAZ_SITE),
        ("d.lcs", DAMIT, ()),
        ("e.csv", TIMES, tuple(option.format(folder=tmp_path) for option in PASS)),
    ):
        (tmp_path / name).write_text(text)
        out = tmp_path / f"{name}.ecsv"
        assert run_cli(["convert", str(tmp_path / name), str(out), *options]) == 0
        assert str(out) in capsys.readouterr().out
        assert read(out).n_obs >= 2


@pytest.mark.parametrize("seed", range(200))
def test_random_damage_is_read_or_refused(seed, tmp_path):
    """Bytes changed, cut or doubled at random: a light curve or one line, never another error."""
    rng = random.Random(seed)
    text = rng.choice([PLAIN, UTC, DAMIT, column("curve", list("aabbcc"))])
    data = bytearray(text.encode())
    for _ in range(rng.randint(1, 4)):
        at = rng.randrange(len(data))
        kind = rng.randrange(4)
        if kind == 0:
            data[at] = rng.randrange(256)
        elif kind == 1:
            del data[at : at + rng.randint(1, 40)]
        elif kind == 2:
            data[at:at] = data[max(at - rng.randint(1, 40), 0) : at]
        else:
            data[at:at] = rng.choice([b"\n", b",", b'"', b"-", b"e9", b"#", b" ", b"nan", b"\xe9"])
        if not data:
            break
    path = tmp_path / "file"
    path.write_bytes(bytes(data))
    message = None
    try:
        curve = read(path)
    except InputError as fault:
        message = str(fault)
    else:
        assert curve.n_obs >= 2
    if message is not None:
        assert str(path) in message
        assert "\n" not in message
