"""A light curve comes back from results as it went in, whatever it was read from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import lcbayes
from lcbayes.core.errors import InputError
from lcbayes.inference.identity import digest
from lcbayes.results.light_curve import light_curve_attributes, light_curve_variables
from lcbayes.results.posterior import save_tree
from tests.helpers import file_readers, small_curves


def tracked(folder: Path) -> lcbayes.LightCurve:  # noqa: ARG001
    bundled = file_readers.SCENARIOS
    return lcbayes.read(bundled / "box-wing.csv", tle=bundled / "box-wing.tle")


def asteroid(folder: Path) -> lcbayes.LightCurve:
    path = folder / "one.lcs"
    path.write_text(file_readers.DAMIT)
    return lcbayes.read(path)


def magnitudes(folder: Path) -> lcbayes.LightCurve:  # noqa: ARG001
    return small_curves.magnitudes(30)


def odd(folder: Path) -> lcbayes.LightCurve:  # noqa: ARG001
    """Names, labels and columns of every kind, times that begin anywhere."""
    light = small_curves.curve(12, exposure_s=np.linspace(0.0, 0.3, 12))
    return replace(
        light,
        t=light.t + 1.0 / 3.0,
        epoch_jd=2460000.123456789,
        curve=np.repeat([0, 1], 6),
        free_scale=np.array([True, False]),
        curve_names=('x,y "q"/z', "Größe"),
        site=np.resize(["", "703"], 12),
        extra={
            "Date/Time (UTC)": np.array([f"2020-01-{i + 1:02d}" for i in range(12)]),
            "counts": np.arange(12),
            "good": np.arange(12) % 2 == 0,
            "place": np.random.default_rng(0).random((12, 3)),
        },
        source={"file": "a b.csv", "format": "csv", "sha256": "ff", "notes": "two rows left out"},
    )


def long(folder: Path) -> lcbayes.LightCurve:  # noqa: ARG001
    """Long enough to be compressed, which must lose nothing."""
    return small_curves.curve(11_000)


def saved(curve: lcbayes.LightCurve, path: Path) -> None:
    tree = xr.DataTree.from_dict(
        {
            "/": xr.Dataset(attrs=light_curve_attributes(curve)),
            "observed_data": xr.Dataset({"brightness": ("time", curve.brightness)}),
            "constant_data": light_curve_variables(curve),
        }
    )
    save_tree(tree, path)


@pytest.mark.parametrize("make", [tracked, asteroid, magnitudes, odd, long])
def test_a_curve_comes_back_identical(tmp_path, make: Callable[[Path], lcbayes.LightCurve]):
    curve = make(tmp_path)
    saved(curve, tmp_path / "posterior.nc")
    with xr.open_datatree(tmp_path / "posterior.nc", engine="h5netcdf") as tree:
        back = lcbayes.load_light_curve(tree)
    for field in fields(curve):
        one, two = getattr(curve, field.name), getattr(back, field.name)
        assert type(one) is type(two), field.name
        if field.name == "extra":
            assert list(one) == list(two)
            for name in one:
                np.testing.assert_array_equal(one[name], two[name], name)
                assert one[name].dtype.kind == two[name].dtype.kind
        elif isinstance(one, np.ndarray):
            assert one.dtype.kind == two.dtype.kind, field.name
            np.testing.assert_array_equal(one, two, field.name)
        else:
            assert one == two, field.name
    assert digest(back) == digest(curve)


def test_results_without_a_curve_are_named_in_a_line():
    with pytest.raises(InputError, match="constant_data is missing"):
        lcbayes.load_light_curve(xr.DataTree())
