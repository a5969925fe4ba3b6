"""The content of a results folder, read once and thinned to the draws that a report can show."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from lcbayes.core.errors import InputError
from lcbayes.data.lightcurve import LightCurve, curve_titles
from lcbayes.results.draws import DARK, LOG_LIKELIHOOD, pointwise, weighted_draws
from lcbayes.results.light_curve import load_light_curve
from lcbayes.results.load import open_posterior, read_json

Floats = NDArray[np.float64]

MOST_PREDICTED = 4_000_000  # draws × epochs of the prediction that are read: 32 MB
STABILISED = "stabilised"  # the model that needs the whole light curve, for the attitude law
FEWEST_DRAWS, MOST_DRAWS = 200, 1000
KINDS = {
    "modes": list,
    "reasons": list,
    "outliers": list,
    "parameters": dict,
    "fit": dict,
    "timing": dict,
}


@dataclass(frozen=True)
class Mode:
    """One solution: its chains, and the brightness predicted by its draws."""

    index: int
    weight: float
    weight_sd: float | None
    draws: xr.Dataset  # dims chain, draw, …
    stats: xr.Dataset  # may be empty
    predicted: Floats  # (S, T); S = 0 if the posterior has no draws of it
    curves: xr.Dataset | None = None  # brightness without noise of some draws
    summary: Mapping[str, Any] = field(default_factory=dict)  # its entry in summary.json

    @property
    def name(self) -> str:
        return f"Solution {self.index + 1}"


@dataclass(frozen=True)
class Results:
    """A results folder in memory. Arrays over T epochs are sorted by time; ``t`` (s) counts from
    the first epoch, whose Julian date is ``attrs["epoch_jd"]``."""

    folder: Path
    attrs: Mapping[str, Any]
    summary: Mapping[str, Any]
    run_toml: str
    modes: list[Mode]
    t: Floats
    brightness: Floats
    error: Floats  # NaN where unknown
    curve: NDArray[np.int64]
    constant: xr.Dataset
    predicted: xr.DataArray | None  # for equally weighted draws, as the next field
    log_likelihood: xr.DataArray | None
    labels: Mapping[str, NDArray[np.str_]] = field(default_factory=dict)
    light_curve: LightCurve | None = None  # in the order of the file, for an attitude law

    @property
    def is_magnitude(self) -> bool:
        return self.attrs.get("kind") == "mag"

    @property
    def is_relative(self) -> bool:
        """Whether all scales are unknown, so that sizes are relative."""
        free = self.constant.get("free_scale")
        return self.normals is not None if free is None else bool(free.all())

    @property
    def span_s(self) -> float:
        return float(np.ptp(self.t)) if self.t.size else 0.0

    @property
    def phase_angle_deg(self) -> Floats:
        """Angle Sun-object-observer, (T,)."""
        sun, obs = (self.constant[k].to_numpy() for k in ("sun", "obs"))
        cross = np.linalg.norm(np.cross(sun, obs), axis=1)
        return np.degrees(np.arctan2(cross, np.sum(sun * obs, axis=1)))

    @property
    def frame(self) -> str:
        return str(self.attrs.get("frame", "inertial"))

    @property
    def normals(self) -> Floats | None:
        """The fixed grid of facet normals, body frame (N, 3), if the model has one."""
        grid = self.constant.get("grid_normals")
        return None if grid is None else grid.to_numpy()


def read(folder: Path) -> Results:
    """Read a results folder.

    Raises
    ------
    InputError
        The folder holds no results, or the files of `lcbayes fit` cannot be read.
    """
    with open_posterior(folder) as tree:
        summary = read_json(folder / "summary.json", KINDS)
        if not all(isinstance(mode, dict) for mode in summary.get("modes") or []):
            raise InputError(f"{folder / 'summary.json'}: modes holds what is no object")
        toml = folder / "run.toml"
        missing = [g for g in ("posterior", "observed_data", "constant_data") if g not in tree]
        if missing:
            raise InputError(
                f"{folder / 'posterior.nc'} has no group {missing[0]}; run `lcbayes fit` again"
            )
        return assemble(
            folder, tree, summary, toml.read_text(encoding="utf-8") if toml.is_file() else ""
        )


def assemble(folder: Path, tree: xr.DataTree, summary: dict[str, Any], toml: str) -> Results:
    constant = tree["constant_data"].to_dataset().load()
    t = constant["t"].to_numpy().astype(float)
    order = np.argsort(t, kind="stable")
    constant, t = constant.isel(time=order), t[order]
    observed = tree["observed_data"].to_dataset()["brightness"].to_numpy()
    size = observed.size
    attrs = {str(k): v for k, v in tree.attrs.items()}
    if "epoch_jd" in attrs:  # of the first point, from which t counts below
        attrs["epoch_jd"] = attrs["epoch_jd"] + t[0] / 86400.0
    drawn = _thinned(tree, size)
    posterior = drawn["posterior"].to_dataset()
    predicted = log_likelihood = None
    if "posterior_predictive" in drawn:
        predicted = drawn["posterior_predictive"].to_dataset()["brightness"].isel(time=order)
    if LOG_LIKELIHOOD in drawn:
        log_likelihood = pointwise(drawn).isel(time=order)
    constant_or = {
        "error": np.full(size, np.nan),
        "curve": np.zeros(size, int),
    } | {k: constant[k].to_numpy() for k in ("error", "curve") if k in constant}
    labels = {k: constant[k].to_numpy().astype(str) for k in ("site", "band") if k in constant}
    index = constant_or["curve"].astype(int)
    names = constant.get("curve_name", xr.DataArray(np.arange(index.max() + 1)))
    labels["curve"] = np.array(curve_titles(names.to_numpy().astype(str).tolist()))[index]
    return Results(
        folder=folder,
        attrs=attrs,
        summary=summary,
        run_toml=toml,
        modes=_modes(tree, posterior, predicted, summary, size),
        t=t - t[0],
        brightness=observed[order].astype(float),
        error=constant_or["error"].astype(float),
        curve=index,
        constant=constant,
        predicted=predicted,
        log_likelihood=log_likelihood,
        light_curve=load_light_curve(tree) if attrs.get("model") == STABILISED else None,
        labels=labels,
    )


def _thinned(tree: xr.DataTree, size: int) -> xr.DataTree:
    """Equally weighted draws, taken evenly from each chain; their number is limited by memory and
    legibility."""
    sizes = tree["posterior"].sizes
    solution = tree["posterior"].coords.get("solution", np.zeros(sizes["chain"], int))
    chains = int(np.unique(solution, return_counts=True)[1].max())
    wanted = int(np.clip(MOST_PREDICTED // max(size, 1), FEWEST_DRAWS, MOST_DRAWS))
    step = max(1, -(-chains * sizes["draw"] // wanted))
    parts = {
        name: tree[name].to_dataset().isel(draw=slice(None, None, step))
        for name in ("posterior", "posterior_predictive", LOG_LIKELIHOOD, DARK)
        if name in tree
    }
    return weighted_draws(xr.DataTree.from_dict(parts), seed=int(tree.attrs.get("seed", 0)))


def _modes(
    tree: xr.DataTree,
    posterior: xr.Dataset,
    predicted: xr.DataArray | None,
    summary: dict[str, Any],
    size: int,
) -> list[Mode]:
    """The solutions, heaviest first; a folder without the group `modes` has one solution."""
    which = np.zeros(posterior.sizes["draw"], int)
    if "solution" in posterior.coords:
        which = posterior["solution"].to_numpy()
    listed = summary.get("modes") or []
    modes = []
    for name in sorted(tree["modes"].children, key=int) if "modes" in tree else [""]:
        node = tree[f"modes/{name}"] if name else tree
        stats = node["sample_stats"].to_dataset().load() if "sample_stats" in node else None
        k = int(name or 0)
        entry = listed[k] if k < len(listed) else {}
        modes.append(
            Mode(
                index=k,
                weight=float(entry.get("weight", np.mean(which == k))),
                weight_sd=entry.get("weight_sd"),
                draws=node["posterior"].to_dataset().load(),
                stats=stats if stats is not None else xr.Dataset(),
                predicted=(
                    np.empty((0, size))
                    if predicted is None
                    else predicted.transpose("chain", "draw", "time").to_numpy()[0, which == k]
                ),
                summary=entry,
                curves=node["curves"].to_dataset().load() if "curves" in node else None,
            )
        )
    return sorted(modes, key=lambda m: -m.weight)
