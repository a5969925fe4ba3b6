"""Columns of other names, and input that is readable but wrong: recognised, said or refused."""

from __future__ import annotations

import gzip

import numpy as np
import pytest

import lcbayes
from lcbayes.core.errors import InputError

VECTORS = "sun_x,sun_y,sun_z,obs_x,obs_y,obs_z"
DIRECTIONS = "1,0,0,0,1,0"


def written(tmp_path, header, rows, name="pass.csv", mark=","):
    lines = [mark.join([*header.split(","), *VECTORS.split(",")])]
    lines += [mark.join([*row, *DIRECTIONS.split(",")]) for row in rows]
    path = tmp_path / name
    path.write_text("\n".join(lines) + "\n")
    return path


TWO = [["2024-01-01 00:00:00", "5.1", "0.02"], ["2024-01-01 00:00:10", "5.2", "0.03"]]


@pytest.mark.parametrize("error", ["err", "MagErr", "mag_error", "e_mag", "sigma", "Uncertainty"])
def test_an_error_of_another_name_is_recognised_and_said(tmp_path, error):
    curve = lcbayes.read(written(tmp_path, f"Date/Time (UTC),mag,{error}", TWO))
    np.testing.assert_allclose(curve.t - curve.t[0], [0.0, 10.0])
    np.testing.assert_array_equal(curve.error, [0.02, 0.03])
    assert f"column {error!r} was taken for mag_err" in curve.source["notes"]
    assert "column 'Date/Time (UTC)' was taken for utc" in curve.source["notes"]


def test_an_error_that_cannot_be_matched_is_refused(tmp_path):
    path = written(tmp_path, "utc,mag,plate_error", TWO)
    with pytest.raises(InputError, match=r"'plate_error' looks like an error.*--columns mag_err="):
        lcbayes.read(path)
    assert lcbayes.read(path, columns="mag_err=plate_error").error is not None
    assert lcbayes.read(path, columns={"ignore": "plate_error"}).error is None


@pytest.mark.parametrize(
    "error",
    [
        "mag_uncert",
        "emag",
        "e_V",
        "dV",
        "V_se",
        "mag +/-",
        "± mag",
        "plus_minus",
        "magnitude_sd",
        "noise",
        "sigV",
        "d_mag",
    ],
)
def test_a_column_that_looks_like_an_error_is_never_left_out_in_silence(tmp_path, error):
    path = written(tmp_path, f"utc,mag,{error}", TWO)
    with pytest.raises(InputError, match=r"looks like an error; say what it is"):
        lcbayes.read(path)
    np.testing.assert_array_equal(
        lcbayes.read(path, columns={"mag_err": error}).error, [0.02, 0.03]
    )


def test_directions_are_not_taken_for_errors(tmp_path):
    rows = [[*row, "0.1", "0.2", "0.3"] for row in TWO]
    curve = lcbayes.read(written(tmp_path, "utc,mag,spare,ex,ey,ez", rows))
    assert "not read: 'spare', 'ex', 'ey', 'ez'" in curve.source["notes"]


def test_without_errors_the_columns_that_are_not_read_are_named(tmp_path):
    curve = lcbayes.read(written(tmp_path, "utc,mag,wobble", TWO))
    assert "not read: 'wobble'; if one is the error" in curve.source["notes"]
    rows = [[*row, "0.5"] for row in TWO]
    with_errors = lcbayes.read(written(tmp_path, "utc,mag,mag_err,wobble", rows))
    assert "not read" not in str(with_errors.source.get("notes"))


def test_a_second_error_is_left_aside_aloud(tmp_path):
    rows = [[*row, "0.5"] for row in TWO]
    curve = lcbayes.read(written(tmp_path, "utc,mag,mag_err,sys_err", rows))
    np.testing.assert_array_equal(curve.error, [0.02, 0.03])
    assert "'sys_err' is left aside" in curve.source["notes"]


def test_two_columns_that_could_be_the_same_are_refused(tmp_path):
    rows = [[*row[:2], "5.3", row[2]] for row in TWO]
    with pytest.raises(InputError, match=r"'V_mag' and 'gmag', each of which could be mag"):
        lcbayes.read(written(tmp_path, "utc,V_mag,gmag,mag_err", rows))


def test_columns_are_mapped_and_the_mapping_is_kept(tmp_path):
    path = written(tmp_path, "Date,V,s", TWO)
    text = 'mag=V,mag_err=s,utc="Date"'
    curve = lcbayes.read(path, columns=text)
    np.testing.assert_array_equal(curve.brightness, [5.1, 5.2])
    assert "columns" in curve.source["reading"]
    with pytest.raises(InputError, match="no column 'W', which --columns names for mag"):
        lcbayes.read(path, columns="mag=W")
    with pytest.raises(InputError, match="--columns names 'magnitud'"):
        lcbayes.read(path, columns={"magnitud": "V"})
    with pytest.raises(InputError, match="expected pairs such as mag=V"):
        lcbayes.read(path, columns="mag")


def test_date_and_time_apart_mjd_time_zones_and_decimal_commas(tmp_path):
    apart = [["2024-01-01", "00:00:00", "5"], ["2024-01-01", "00:00:10.5", "6"]]
    zone = [["2024-01-01T01:00:00+01:00", "5"], ["2023-12-31T21:00:10.5-03:00", "6"]]
    mjd = [["60310", "5"], ["60310.00012152777777", "6"]]
    curves = [
        lcbayes.read(written(tmp_path, "Date,Time,mag", apart)),
        lcbayes.read(written(tmp_path, "utc,mag", zone)),
        lcbayes.read(written(tmp_path, "MJD,mag", mjd)),
    ]
    for curve in curves:
        assert curve.epoch_jd is not None
        start = curve.epoch_jd + curve.t[0] / 86400.0
        assert start == pytest.approx(2460310.5, abs=1e-9)
        assert np.diff(curve.t) == pytest.approx([10.5], abs=1e-4)
    commas = [["0,5", "5,25", "0,02"], ["10", "6,5", "0,02"]]
    curve = lcbayes.read(written(tmp_path, "t,mag,err", commas, mark=";"))
    np.testing.assert_array_equal(curve.brightness, [5.25, 6.5])
    np.testing.assert_array_equal(curve.t, [0.5, 10.0])


def test_a_gzipped_file_is_read(tmp_path):
    path = written(tmp_path, "utc,mag,mag_err", TWO)
    packed = tmp_path / "pass.csv.gz"
    packed.write_bytes(gzip.compress(path.read_bytes()))
    assert lcbayes.read(packed).source["sha256"] == lcbayes.read(path).source["sha256"]
    packed.write_bytes(gzip.compress(path.read_bytes())[:-20])
    with pytest.raises(InputError, match="gzip"):
        lcbayes.read(packed)


@pytest.mark.parametrize("missing", ["99.99", "-99", "99.0", "999"])
def test_sentinels_are_refused(tmp_path, missing):
    rows = [TWO[0], ["2024-01-01 00:00:10", missing, "0.03"]]
    with pytest.raises(InputError, match=r"outside -30 .. 40 mag .*line 3.*missing measurements"):
        lcbayes.read(written(tmp_path, "utc,mag,mag_err", rows))
    rows = [TWO[0], ["2024-01-01 00:00:10", "5.2", "9.99"]]
    with pytest.raises(InputError, match="missing measurements"):
        lcbayes.read(written(tmp_path, "utc,mag,mag_err", rows))


@pytest.mark.parametrize(("value", "what"), [("12000", "counts"), ("8.3", "magnitudes")])
def test_counts_and_magnitudes_under_flux_are_refused(tmp_path, value, what):
    rows = [["0", value, "800"], ["10", value, "810"]]
    with pytest.raises(InputError, match=what):
        lcbayes.read(written(tmp_path, "t,flux,range_km", rows))
    relative = [[*row, "0"] for row in rows]
    assert lcbayes.read(written(tmp_path, "t,flux,range_km,calibrated", relative)).free_scale.all()


def test_what_a_flux_without_a_range_means_is_said(tmp_path):
    rows = [["0", "8.3"], ["10", "8.4"]]
    notes = lcbayes.read(written(tmp_path, "t,flux", rows)).source["notes"]
    assert "reduced to 1 m under unit sunlight" in notes
