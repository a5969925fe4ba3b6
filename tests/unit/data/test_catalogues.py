"""Catalogues of many objects: every layout gives the same points, and faults name their place."""

from __future__ import annotations

import gzip
import sys
from dataclasses import replace

import numpy as np
import pytest

from lcbayes.core.errors import InputError
from lcbayes.data.catalogues import parquet
from lcbayes.data.catalogues.opened import catalogue
from lcbayes.data.plausible import check_flux_of_asteroid
from lcbayes.data.read import read
from tests.helpers import sparse_surveys
from tests.helpers.survey_catalogues import (
    asteroids_at_home,
    points,
    write_csv,
    write_flat,
    write_nested,
)


@pytest.fixture(scope="module")
def objects():
    return points(3)


def parts(objects, folder):
    """A folder of two files, the first with two objects."""
    folder.mkdir()
    names = list(objects)
    write_flat({k: objects[k] for k in names[:2]}, folder / "part-0.parquet")
    write_flat({k: objects[k] for k in names[2:]}, folder / "part-1.parquet")
    return folder


def packed(objects, path):
    plain = write_csv(objects, path.with_suffix(".plain"))
    path.write_bytes(gzip.compress(plain.read_bytes()))
    return path


LAYOUTS = {
    "CSV": write_csv,
    "compressed CSV": packed,
    "rows": write_flat,
    "parts": parts,
    **{
        kind: (lambda o, path, kind=kind: write_nested(o, path, kind))
        for kind in ("lists", "struct of lists", "list of structs")
    },
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_layout_gives_the_points(layout, objects, tmp_path, monkeypatch):
    monkeypatch.setattr(parquet, "POINTS", 50)  # objects of 120 points span several batches
    monkeypatch.setattr(parquet, "OBJECTS", 2)
    source = catalogue(LAYOUTS[layout](objects, tmp_path / "survey"))
    assert source.count() == 3
    entries = list(source.objects())
    assert [entry.name for entry in entries] == list(objects)
    for entry in entries:
        curve, given = read(entry.file), objects[entry.name]
        np.testing.assert_array_equal(curve.brightness, given["flux"])
        sun = np.stack([given[f"sun_{axis}"] for axis in "xyz"], 1)
        np.testing.assert_allclose(2.6 * curve.sun, sun, rtol=1e-14)
        # Julian dates are UTC, and the second of June 2012 is a leap second
        np.testing.assert_allclose(np.diff(curve.t), 86400 * np.diff(given["jd"]), 0, 1.001)
        assert curve.frame == "ecliptic-j2000"
        assert curve.free_scale.tolist() == [True]


def test_objects_are_read_one_after_another(objects, tmp_path, monkeypatch):
    """The second batch is not decoded before an object of it is asked for."""
    monkeypatch.setattr(parquet, "OBJECTS", 1)
    read_batches = []
    original = parquet._flat
    monkeypatch.setattr(parquet, "_flat", lambda *a: read_batches.append(1) or original(*a))
    stream = catalogue(write_nested(objects, tmp_path / "survey")).objects()
    assert read_batches == []
    assert next(stream).name == "A0"
    assert len(read_batches) == 1


@pytest.mark.parametrize("kind", ["CSV", "rows"])
def test_faults_name_their_place(kind, objects, tmp_path):
    bad = {k: {n: v.copy() for n, v in columns.items()} for k, columns in objects.items()}
    bad["A1"]["flux"][4] = np.nan
    entry = list(catalogue(LAYOUTS[kind](bad, tmp_path / "survey")).objects())[1]
    with pytest.raises(InputError) as caught:
        read(entry.file)
    # below a comment and the header, 120 rows of A0 and five of A1
    place = "survey, line 127" if kind == "CSV" else "survey, object A1, row 5"
    assert place in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("column", "given", "message"),
    [
        ("asteroid", None, ""),
        ("Object ID", None, ""),
        ("body", "body", ""),
        ("body", None, "no column that names the objects .it has: body, jd"),
        ("body", "bodi", "no column 'bodi' .did you mean body"),
    ],
)
@pytest.mark.parametrize("write", [write_csv, write_flat])
def test_the_column_of_names(column, given, message, write, objects, tmp_path):
    path = write(objects, tmp_path / "survey", column)
    if message:
        with pytest.raises(InputError, match=message):
            catalogue(path, given).count()
    else:
        assert catalogue(path, given).count() == 3


@pytest.mark.parametrize("write", [write_csv, write_flat])
def test_rows_of_an_object_are_together(write, objects, tmp_path):
    path = write({"A": objects["A0"], "B": objects["A1"], "A ": objects["A2"]}, tmp_path / "survey")
    with pytest.raises(InputError, match="rows of object 'A' are not together; sort"):
        catalogue(path).count()


def test_whole_numbers_stored_as_floats_are_names(objects, tmp_path):
    path = write_flat({10537.0: objects["A0"], 7.0: objects["A1"]}, tmp_path / "survey")  # type: ignore[dict-item]
    assert [entry.name for entry in catalogue(path).objects()] == ["10537", "7"]


def test_a_folder_of_period_searches_and_damit_files(tmp_path):
    curve = sparse_surveys.observed()
    text = asteroids_at_home(curve)
    (tmp_path / "period_search_in_10537").write_text(text)
    (tmp_path / "period_search_in_8").write_text("cut short\n")
    (tmp_path / "README").write_text("About these files\n")
    inside = tmp_path / "damit"
    inside.mkdir()
    (inside / "43.lcs").write_text("\n".join(text.splitlines()[14:]).replace(" 0 0", " 0"))
    (inside / "44.lcs").write_text("1\n5 0\n2455000 1 1 0 0\n")
    source = catalogue(tmp_path)
    assert source.count() == 4
    result = {entry.name: entry for entry in source.objects()}
    assert list(result) == ["damit/43", "damit/44", "10537", "8"]
    for name in ("10537", "damit/43"):
        assert read(result[name].file).n_obs == curve.n_obs
    assert [path.name for path in source.left_out] == ["README"]  # type: ignore[attr-defined]
    with pytest.raises(InputError, match="5 points are announced"):
        read(result["damit/44"].file)
    with pytest.raises(InputError, match="leave out --object name"):
        catalogue(tmp_path, "name")
    assert catalogue(f"{tmp_path}/damit/*.lcs").count() == 2


def test_what_is_no_catalogue(tmp_path, objects, monkeypatch):
    with pytest.raises(InputError, match="does not exist"):
        catalogue(tmp_path / "no.csv")
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="holds no light curve"):
        catalogue(tmp_path / "empty").count()
    broken = tmp_path / "broken.parquet"
    broken.write_bytes(b"PAR1 and more")
    with pytest.raises(InputError, match="cannot be read"):
        catalogue(broken).count()
    head = tmp_path / "head.csv"
    head.write_text("object,jd,flux\n")
    with pytest.raises(InputError, match="no rows"):
        catalogue(head).count()
    nameless = tmp_path / "nameless.csv"
    nameless.write_text("object,jd,flux\nA,2455000.5,1\n,2455001.5,1\n")
    with pytest.raises(InputError, match="line 3 names no object"):
        catalogue(nameless).count()
    path = write_flat(objects, tmp_path / "survey")
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    monkeypatch.delitem(sys.modules, "pyarrow", raising=False)
    with pytest.raises(InputError, match=r"needs pyarrow; it comes with pip install 'lcbayes\[par"):
        catalogue(path).count()


def test_lists_of_different_lengths_are_a_fault_of_their_object(objects, tmp_path):
    bad = dict(objects)
    bad["A1"] = bad["A1"] | {"flux": bad["A1"]["flux"][:-1]}
    entries = list(catalogue(write_nested(bad, tmp_path / "survey")).objects())
    assert [entry.file is None for entry in entries] == [False, True, False]
    assert "object A1: the columns of the table differ in length" in entries[1].fault


def test_magnitudes_are_no_fluxes_of_an_asteroid():
    curve = sparse_surveys.observed()
    check_flux_of_asteroid(curve)
    magnitudes = 18.0 - 2.5 * np.log10(curve.brightness)
    with pytest.raises(InputError, match="grows with the phase angle, as magnitudes do"):
        check_flux_of_asteroid(replace(curve, brightness=magnitudes))
    check_flux_of_asteroid(replace(curve, brightness=10.0 * curve.brightness))
    check_flux_of_asteroid(replace(curve, brightness=magnitudes, kind="mag"))
