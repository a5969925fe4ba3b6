"""A fit in files: the posterior as an ArviZ DataTree, the summary, and what it takes to rerun."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from lcbayes.core.files import write_atomic
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inference.fit import Mode, Posterior, constrain_draws
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.likelihood import OBSERVED, OUTLIER
from lcbayes.modelling.problem import Problem
from lcbayes.modelling.registry import Entry

Floats = NDArray[np.float64]

# Axes of the variables that models record, after chain and draw.
AXES: dict[str, tuple[str, ...]] = {
    "albedo_area": ("facet",),
    "log_albedo_area": ("facet",),
    "phi": ("facet",),
    "g": ("facet",),
    "normals": ("facet", "xyz"),
    "normals_base": ("facet", "xyz"),
    "omega": ("axis",),
    "omega_unit": ("axis",),
    "scale": ("curve",),
    "log_level": ("level",),
    "noise": ("curve",),
    "noise_unit": ("curve",),
    "coefficients": ("coefficient",),
    "inertia_base": ("shape",),
    "inertia_ratio": ("moment",),
    "area": ("facet",),
    "r_diff": ("facet",),
    "r_spec": ("facet",),
    "w": ("facet",),
    "nu": ("facet",),
    "n": ("facet",),
    "m": ("facet",),
    "member_offset": ("member",),
    "site_offset": ("site",),
    "log_nu": ("facet",),
    "log_n": ("facet",),
    "log_m": ("facet",),
}
STATS = {
    "potential_energy": "lp",
    "accept_prob": "acceptance_rate",
    "num_steps": "n_steps",
    "diverging": "diverging",
    "energy": "energy",
}


def dataset(draws: Mapping[str, NDArray]) -> xr.Dataset:
    """Draws {name: (C, S, ...)} with named axes."""
    variables = {}
    for name, values in draws.items():
        rank = values.ndim - 2
        axes = AXES.get(name, ())
        if len(axes) != rank:
            axes = tuple(f"{name}_{i}" for i in range(rank))
        variables[name] = (("chain", "draw", *axes), values)
    data = xr.Dataset(variables)
    letters = {d: list("xyz") for d in ("xyz", "axis") if data.sizes.get(d) == 3}
    ranges = {d: np.arange(n) for d, n in data.sizes.items() if d not in letters}
    return data.assign_coords({**ranges, **letters})


def tree(
    posterior: Posterior, curve: LightCurve, entry: Entry, options: Mapping[str, Any], seed: int
) -> xr.DataTree:
    """The DataTree of a fit, with every group of the design."""
    problem, data = posterior.problem, posterior.data
    z, label = posterior.mixture(seed)
    mixed = constrain_draws(problem, z, data)
    draws = dataset(mixed).assign(mode=(("chain", "draw"), label))
    pointwise, replicated = _predictions(problem, z, data, seed)
    probability = _outliers(problem, z, data)
    outliers = {} if probability is None else {OUTLIER: (("time",), probability)}
    time = ("chain", "draw", "time")
    groups: dict[str, xr.Dataset] = {
        "posterior": draws,
        "log_likelihood": xr.Dataset({OBSERVED: (time, pointwise)}),
        "posterior_predictive": xr.Dataset({OBSERVED: (time, replicated)} | outliers),
        "prior": dataset(_prior(problem, data, seed)),
        "observed_data": xr.Dataset({OBSERVED: (("time",), curve.brightness)}),
        "constant_data": _constants(curve, data, entry, options),
    }
    if len(posterior.modes) == 1:
        groups["sample_stats"] = _stats(posterior.modes[0])
    for i, mode in enumerate(posterior.modes):
        groups[f"modes/{i}/posterior"] = dataset(constrain_draws(problem, mode.z, data))
        groups[f"modes/{i}/sample_stats"] = _stats(mode)
    return xr.DataTree.from_dict(groups)


def _stats(mode: Mode) -> xr.Dataset:
    stats = {STATS[k]: (("chain", "draw"), v) for k, v in mode.stats.items()}
    dims, energy = stats["lp"]
    stats["lp"] = (dims, -energy)
    return xr.Dataset(stats)


def _predictions(problem: Problem, z: Floats, data: Epochs, seed: int) -> tuple[Floats, Floats]:
    """Pointwise log likelihood and one replicate of the data for each draw, (C, S, T)."""
    keys = jax.random.split(jax.random.fold_in(jax.random.key(seed), 1), z.shape[0] * z.shape[1])
    rows = jnp.asarray(z.reshape(-1, z.shape[-1]))
    pointwise, replicated = _predicted(problem, rows, keys, data)
    shape = (*z.shape[:2], -1)
    return np.asarray(pointwise).reshape(shape), np.asarray(replicated).reshape(shape)


@partial(jax.jit, static_argnums=0)
def _predicted(problem: Problem, rows: jax.Array, keys: jax.Array, data: Epochs):
    def one(args):
        row, key = args
        return problem.log_likelihood(row, data), problem.replicate(row, data, key)

    return jax.lax.map(one, (rows, keys))


def _outliers(problem: Problem, z: Floats, data: Epochs) -> Floats | None:
    """Probability that each point is an outlier, (T,), where the noise knows of any."""
    rows = jnp.asarray(z.reshape(-1, z.shape[-1]))
    if OUTLIER not in jax.eval_shape(problem.constrain, rows[0], data):
        return None
    each = jax.jit(lambda a: jax.lax.map(lambda row: problem.constrain(row, data)[OUTLIER], a))
    return np.asarray(each(rows)).mean(axis=0)


def _prior(problem: Problem, data: Epochs, seed: int, n: int = 500) -> dict[str, NDArray]:
    keys = jax.random.split(jax.random.fold_in(jax.random.key(seed), 2), n)
    draws = _prior_draws(problem, keys, data)
    return constrain_draws(problem, np.asarray(draws)[None], data)


@partial(jax.jit, static_argnums=0)
def _prior_draws(problem: Problem, keys: jax.Array, data: Epochs) -> jax.Array:
    return jax.lax.map(lambda key: problem.prior_draw(key, data), keys)


def _constants(
    curve: LightCurve, data: Epochs, entry: Entry, options: Mapping[str, Any]
) -> xr.Dataset:
    out = xr.Dataset(
        {
            "t": (("time",), np.asarray(data.t), {"units": "s"}),
            "sun": (("time", "xyz"), curve.sun),
            "obs": (("time", "xyz"), curve.obs),
            "error": (("time",), np.asarray(data.error)),
            "curve": (("time",), curve.curve),
            "exposure_s": (("time",), curve.exposure_s),
            "free_scale": (("curve_index",), curve.free_scale),
            "curve_name": (("curve_index",), np.array(curve.curve_names, dtype=str)),
        }
    )
    for name in ("site", "band"):
        if np.any(getattr(curve, name) != ""):
            out[name] = (("time",), getattr(curve, name).astype(str))
    if curve.range_km is not None:
        out["range_km"] = (("time",), curve.range_km)
    if (hook := entry.hook("constants")) is not None:
        for name, values in hook(data, **options).items():
            axes = ("facet", "xyz") if name == "grid_normals" else None
            out[name] = (axes or tuple(f"{name}_{i}" for i in range(np.ndim(values))), values)
    return out


def save_tree(found: xr.DataTree, path: Path) -> None:
    """Write netCDF; large groups in single precision, compressed."""
    encoding: dict[str, dict[str, Any]] = {}
    for node in found.subtree:
        for name, variable in node.data_vars.items():
            if variable.dtype.kind == "f" and variable.size > 10_000:
                kind = "f4" if "time" in variable.dims else "f8"
                encoding.setdefault(node.path, {})[str(name)] = {
                    "zlib": True,
                    "complevel": 1,
                    "shuffle": True,
                    "dtype": kind,
                }
    # made in memory: HDF5 crashes the process where the disk fills while it writes
    with _without_cluster():
        content = found.to_netcdf(engine="h5netcdf", encoding=encoding)
    write_atomic(path, lambda p: p.write_bytes(content))


def _without_cluster() -> AbstractContextManager[Any]:
    """On a Dask worker xarray would lock what it writes for the whole cluster, by its name; a file
    in memory has none."""
    dask = sys.modules.get("dask")
    return nullcontext() if dask is None else dask.config.set(scheduler="threads")
