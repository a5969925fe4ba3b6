"""Tables in memory: read as the same table in a file, and faults in one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from astropy.table import Table
from astropy.time import Time

import lcbayes
from lcbayes.core.errors import InputError
from tests.helpers.small_curves import curve as small

FIELDS = ("t", "brightness", "error", "sun", "obs", "kind", "free_scale", "epoch_jd", "frame")


def same(one: lcbayes.LightCurve, other: lcbayes.LightCurve) -> None:
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


def test_pandas_and_back():
    curve = small(n=12)
    table = curve.to_pandas()
    assert list(table.columns)[:3] == ["t", "flux", "flux_err"]
    same(lcbayes.read(table), curve)
    assert len(curve) == len(table) == 12


@pytest.mark.parametrize("make", [dict, Table, pd.DataFrame])
def test_other_names_dates_and_text(make, tmp_path):
    clock = np.array(["2026-01-01T00:00:00", "2026-01-01T00:00:10"], dtype="datetime64[ns]")
    columns = {
        "Date/Time": clock,
        "magnitude": [8.0, 8.1],
        "err": [0.1, 0.1],
        "site": ["a", "b"],
    }
    curve = lcbayes.read(make(columns), geometry=False)
    assert curve.t.tolist() == [0.0, 10.0]
    assert curve.site.tolist() == ["a", "b"]
    assert "'magnitude' was taken for mag" in curve.source["notes"]
    file = tmp_path / "same.csv"
    pd.DataFrame(columns | {"Date/Time": [f"{t}Z" for t in clock]}).to_csv(file, index=False)
    same(lcbayes.read(file, geometry=False), curve)


def test_astropy_times_quantities_and_masks():
    table = Table({"utc": Time(["2026-01-01", "2026-01-02"]), "mag": np.ma.array([8.0, 9.0])})
    assert lcbayes.read(table, geometry=False).t.tolist() == [0.0, 86400.0]
    table = Table({"utc": table["utc"], "mag": np.ma.array([8.0, 9.0], mask=[False, True])})
    with pytest.raises(InputError, match="mag"):
        lcbayes.read(table, geometry=False)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({}, "the table has no rows"),
        ({"t": [], "mag": []}, "the table has no rows"),
        ({"t": [1, 2], "mag": [3]}, r"differ in length \(t 2, mag 1\)"),
        ({"t": [[1], [2]], "mag": [3, 4]}, r"column 't' of the table has shape \(2, 1\)"),
        ({"t": [1, 2], "mag": [3, None]}, "mag"),
        ({"t": [2, 1], "mag": [3, 4]}, "earlier than the row before"),
    ],
)
def test_faults_are_one_line(table, message):
    with pytest.raises(InputError, match=message) as caught:
        lcbayes.read(table, geometry=False)
    assert "\n" not in str(caught.value)


def test_parquet(tmp_path, monkeypatch):
    path = tmp_path / "curve.parquet"
    path.write_bytes(b"PAR1 and more")
    table = small(n=6).to_pandas()
    monkeypatch.setattr(pd, "read_parquet", lambda _: table)
    same(lcbayes.read(path), small(n=6))

    def none(_):
        raise ImportError

    monkeypatch.setattr(pd, "read_parquet", none)
    with pytest.raises(InputError, match=r"needs pyarrow: pip install 'lcbayes\[parquet\]'"):
        lcbayes.read(path)


def test_a_plot():
    curve = small(n=6)
    axes = curve.plot().axes[0]
    assert axes.get_xlabel() == "time (s)"
    assert len(axes.containers[0][0].get_xdata()) == 6
    assert curve.plot(axes) is axes.figure


def test_a_site_and_an_average_may_be_numbers():
    bundled = Path(lcbayes.__file__).parent / "simulation" / "scenarios" / "box-wing"
    table = pd.read_csv(bundled.with_suffix(".csv"), comment="#")
    table = table[table["site"] == "Calar Alto"].drop(columns=[c for c in table if "site" in c])
    tle = bundled.with_suffix(".tle")
    text = lcbayes.read(table, site="37.2,-2.5,2168", average="8", tle=tle)
    same(lcbayes.read(table, site=(37.2, -2.5, 2168), average=8, tle=tle), text)
    same(lcbayes.read(table, site=[37.2, -2.5, 2168.0], average=8.0, tle=tle), text)
    assert len(text) < len(table)
    with pytest.raises(InputError, match="site"):
        lcbayes.read(table, site=(37.2, -2.5), tle=tle)
