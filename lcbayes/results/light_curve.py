"""The light curve stored with the results of a fit, complete and in double precision."""

# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownArgumentType=false, reportUnknownVariableType=false
# (pandas, xarray, ArviZ and JAX come without complete types)

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from lcbayes.core.errors import InputError
from lcbayes.data.lightcurve import ORBIT, LightCurve
from lcbayes.modelling.likelihood import OBSERVED

EXTRA = "extra_column_"  # prefix of variables that hold `LightCurve.extra`, named by an attribute
COLUMN = "column"
SOURCE = "source"  # attribute: JSON of `LightCurve.source`


def light_curve_variables(curve: LightCurve) -> xr.Dataset:
    """All of a light curve except its brightness, for the group ``constant_data``.

    ``error`` is NaN if the curve has no errors; ``range_km``, ``position_km``, ``velocity_km_s``,
    ``band`` and ``site`` are present only if they are known.
    """
    time = ("time",)
    error = np.full(curve.n_obs, np.nan) if curve.error is None else curve.error
    variables: dict[str, Any] = {
        "t": (time, curve.t, {"units": "s"}),
        "error": (time, error),
        "sun": (("time", "xyz"), curve.sun),
        "obs": (("time", "xyz"), curve.obs),
        "curve": (time, curve.curve),
        "exposure_s": (time, curve.exposure_s, {"units": "s"}),
        "free_scale": (("curve_index",), curve.free_scale),
        "curve_name": (("curve_index",), np.array(curve.curve_names, dtype=str)),
    }
    for name in ("site", "band"):
        if np.any(getattr(curve, name) != ""):
            variables[name] = (time, getattr(curve, name).astype(str))
    if curve.range_km is not None:
        variables["range_km"] = (time, curve.range_km, {"units": "km"})
    for name in ORBIT:
        if (value := getattr(curve, name)) is not None:
            variables[name] = (("time", "xyz"), value)
    for i, (name, value) in enumerate(curve.extra.items()):
        axes = tuple(f"{EXTRA}{i}_{k}" for k in range(value.ndim - 1))
        value = value.astype(str) if value.dtype.kind == "O" else value
        variables[f"{EXTRA}{i}"] = (("time", *axes), value, {COLUMN: json.dumps(name)})
    return xr.Dataset(variables, attrs={SOURCE: json.dumps(dict(curve.source))})


def light_curve_attributes(curve: LightCurve) -> dict[str, Any]:
    """Values that apply to the whole curve, for the attributes of the file."""
    epoch = {} if curve.epoch_jd is None else {"epoch_jd": curve.epoch_jd}
    return epoch | {"kind": curve.kind, "frame": curve.frame}


def load_light_curve(tree: xr.DataTree) -> LightCurve:
    """The fitted light curve, from ``posterior.nc`` alone.

    Parameters
    ----------
    tree : xarray.DataTree
        ``posterior.nc`` of a fit, or `lcbayes.Fit.tree`. Brightness comes from ``observed_data``,
        times (s since ``epoch_jd``), errors and geometry from ``constant_data``, and ``kind``,
        ``frame`` and ``epoch_jd`` from the attributes of the file.

    Returns
    -------
    LightCurve
        Identical to the curve given to `lcbayes.fit` in every field.

    Raises
    ------
    InputError
        The tree does not hold a complete light curve.

    Examples
    --------
    >>> import lcbayes
    >>> curve = lcbayes.simulate("one-facet", seed=1).data
    >>> short = dict(num_starts=8, num_warmup=10, num_samples=10, num_chains=2)
    >>> fit = lcbayes.fit(curve, n_facets=1, spin="none", **short)
    >>> (lcbayes.load_light_curve(fit.tree).brightness == curve.brightness).all().item()
    True
    """
    try:
        constant = tree["constant_data"].to_dataset()
        brightness = tree["observed_data"][OBSERVED].to_numpy()
        return _curve(constant, brightness, tree.attrs)
    except KeyError as fault:
        raise InputError(
            f"the results hold no complete light curve ({fault.args[0]} is missing); run "
            "`lcbayes fit` again"
        ) from None


def _curve(constant: xr.Dataset, brightness: np.ndarray, attrs: Mapping[Any, Any]) -> LightCurve:
    def known(name: str) -> np.ndarray | None:
        return constant[name].to_numpy() if name in constant else None

    error = constant["error"].to_numpy()
    epoch_jd = attrs.get("epoch_jd")
    names = known("curve_name")
    extra = [v for k, v in constant.data_vars.items() if str(k).startswith(EXTRA)]
    optional: dict[str, Any] = {
        name: known(name) for name in ("exposure_s", "free_scale", "range_km", *ORBIT)
    }
    labels: dict[str, Any] = {
        k: v.astype(str) for k in ("band", "site") if (v := known(k)) is not None
    }
    return LightCurve(
        t=constant["t"].to_numpy(),
        brightness=brightness,
        error=None if np.isnan(error).all() else error,
        sun=constant["sun"].to_numpy(),
        obs=constant["obs"].to_numpy(),
        kind=str(attrs["kind"]),
        curve=constant["curve"].to_numpy(),
        curve_names=() if names is None else tuple(map(str, names)),
        epoch_jd=None if epoch_jd is None else float(epoch_jd),
        frame=str(attrs["frame"]),
        extra={json.loads(v.attrs[COLUMN]): _plain(v.to_numpy()) for v in extra},
        source=json.loads(constant.attrs.get(SOURCE, "{}")),
        **labels,
        **optional,
    )


def _plain(values: np.ndarray) -> np.ndarray:
    """The values, with strings that a file returns as objects converted back."""
    return values.astype(str) if values.dtype.kind == "O" else values
