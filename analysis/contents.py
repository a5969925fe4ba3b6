"""What a results folder holds, read once, thinned to what a report can show."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from lcbayes.core.errors import InputError
from lcbayes.results.load import open_posterior, read_json

Floats = NDArray[np.float64]

MOST_PREDICTED = 4_000_000  # draws × epochs read of what is predicted: 32 MB
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
    """One solution: its own chains, and the brightness its share of the posterior predicts."""

    index: int
    weight: float
    weight_sd: float | None
    draws: xr.Dataset  # dims chain, draw, …
    stats: xr.Dataset  # may be empty
    predicted: Floats  # (S, T); S = 0 where the posterior holds none of it
    summary: Mapping[str, Any] = field(default_factory=dict)  # its entry in summary.json

    @property
    def name(self) -> str:
        return f"Solution {self.index + 1}"


@dataclass(frozen=True)
class Results:
    """A results folder in memory. Arrays over T epochs are sorted by time."""

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
    posterior: xr.Dataset  # all solutions mixed by weight, thinned like the next two
    predicted: xr.DataArray | None
    log_likelihood: xr.DataArray | None
    labels: Mapping[str, NDArray[np.str_]] = field(default_factory=dict)

    @property
    def is_magnitude(self) -> bool:
        return self.attrs.get("kind") == "mag"

    @property
    def is_relative(self) -> bool:
        """Whether no curve has a known scale, so that sizes are relative."""
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
        """The fixed grid of facet normals, body frame (N, 3), of models that have one."""
        grid = self.constant.get("grid_normals")
        return None if grid is None else grid.to_numpy()


def read(folder: Path) -> Results:
    """Read a results folder.

    Raises
    ------
    InputError
        If it is none, or if what `lcbayes fit` wrote there cannot be read.
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
        return _assemble(
            folder, tree, summary, toml.read_text(encoding="utf-8") if toml.is_file() else ""
        )


def _assemble(folder: Path, tree: xr.DataTree, summary: dict[str, Any], toml: str) -> Results:
    constant = tree["constant_data"].to_dataset().load()
    observed = tree["observed_data"].to_dataset()["brightness"].to_numpy()
    order = np.argsort(constant["t"].to_numpy(), kind="stable")
    constant = constant.isel(time=order)
    size = observed.size

    # Thin draws evenly, per chain, to what can be held and seen.
    mixed = tree["posterior"].to_dataset()
    chains, draws = mixed.sizes["chain"], mixed.sizes["draw"]
    wanted = int(np.clip(MOST_PREDICTED // max(size, 1), FEWEST_DRAWS, MOST_DRAWS))
    step = max(1, -(-chains * draws // wanted))
    thin = {"draw": slice(None, None, step)}

    def brightness(group: str) -> xr.DataArray | None:
        if group not in tree or "brightness" not in tree[group]:
            return None
        return tree[group].to_dataset()["brightness"].isel(thin).load().isel(time=order)

    posterior = mixed.isel(thin).load()
    predicted = brightness("posterior_predictive")
    constant_or = {
        "error": np.full(size, np.nan),
        "curve": np.zeros(size, int),
    } | {k: constant[k].to_numpy() for k in ("error", "curve") if k in constant}
    return Results(
        folder=folder,
        attrs={str(k): v for k, v in tree.attrs.items()},
        summary=summary,
        run_toml=toml,
        modes=_modes(tree, mixed, posterior, predicted, summary, size),
        t=constant["t"].to_numpy().astype(float),
        brightness=observed[order].astype(float),
        error=constant_or["error"].astype(float),
        curve=constant_or["curve"].astype(int),
        constant=constant,
        posterior=posterior,
        predicted=predicted,
        log_likelihood=brightness("log_likelihood"),
        labels={k: constant[k].to_numpy().astype(str) for k in ("site", "band") if k in constant},
    )


def _modes(
    tree: xr.DataTree,
    mixed: xr.Dataset,
    posterior: xr.Dataset,
    predicted: xr.DataArray | None,
    summary: dict[str, Any],
    size: int,
) -> list[Mode]:
    """The solutions, heaviest first; a folder without the group `modes` has one."""
    which = posterior["mode"].to_numpy() if "mode" in posterior else None
    names = sorted(tree["modes"].children, key=int) if "modes" in tree else ["0"]
    listed = summary.get("modes") or []
    found = []
    for name in names:
        k = int(name)
        if "modes" in tree:
            node = tree[f"modes/{name}"]
            draws = node["posterior"].to_dataset().load()
            stats = node["sample_stats"].to_dataset().load() if "sample_stats" in node else None
        else:
            draws = mixed.load()
            stats = tree["sample_stats"].to_dataset().load() if "sample_stats" in tree else None
        mine = np.ones(posterior.sizes["chain"] * posterior.sizes["draw"], bool)
        if which is not None:
            mine = (which == k).ravel()
        entry = listed[k] if k < len(listed) else {}
        weight = entry.get("weight", float(np.mean(mine)))
        found.append(
            Mode(
                index=k,
                weight=float(weight),
                weight_sd=entry.get("weight_sd"),
                draws=draws.drop_vars("mode", errors="ignore"),
                stats=stats if stats is not None else xr.Dataset(),
                predicted=(
                    np.empty((0, size))
                    if predicted is None
                    else predicted.transpose("chain", "draw", "time")
                    .to_numpy()
                    .reshape(-1, size)[mine]
                ),
                summary=entry,
            )
        )
    return sorted(found, key=lambda m: -m.weight)
