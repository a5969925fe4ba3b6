"""The file of a scan, with everything that its report shows."""

# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownArgumentType=false, reportUnknownVariableType=false
# (pandas, xarray, ArviZ and JAX come without complete types)

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from lcbayes.core.cluster import without_cluster
from lcbayes.core.errors import InputError
from lcbayes.core.files import write_atomic
from lcbayes.inversion.attitude_scan.engine import Settings
from lcbayes.inversion.attitude_scan.result import AttitudeScan, Solution, Table

ABOUT = "about"  # attribute: JSON of everything that is not an array
ARRAYS = ("residual", "normals", "areas", "pole", "coefficients")
AXES = {  # no axis has the name of its variable, which would make that variable a coordinate
    "residual": "time",
    "normals": "facet",
    "areas": "facet",
    "pole": "xyz",
    "coefficients": "coefficient",
}
SCREENED = ("start", "tried", "pole", "frequency", "chi2", "steps")


def save_scan(scan: AttitudeScan, path: Path) -> None:
    """Write netCDF: ``light_curve``, ``screened``, ``sky`` and ``solutions/0`` (the best), …"""
    groups = {
        "/": xr.Dataset(attrs={ABOUT: json.dumps(_plain(scan))}),
        "light_curve": xr.Dataset({k: ("time", getattr(scan, k)) for k in ("t", "curve", "flux")}),
    }
    if scan.screened is not None:
        columns = {k: np.asarray(getattr(scan.screened, k)) for k in SCREENED}
        groups["screened"] = _dataset(columns, "hypothesis")
    if scan.sky is not None:
        groups["sky"] = _dataset({"pole": scan.sky[0], "chi2": scan.sky[1]}, "direction")
    for i, solution in enumerate(scan.solutions):
        arrays = {k: v for k in ARRAYS if (v := getattr(solution, k)) is not None}
        about = {k: v for k, v in asdict(solution).items() if k not in ARRAYS}
        variables = {k: ((AXES[k], "xyz")[: np.ndim(v)], np.asarray(v)) for k, v in arrays.items()}
        groups[f"solutions/{i}"] = xr.Dataset(variables, attrs={ABOUT: json.dumps(about)})
    with without_cluster():
        content = xr.DataTree.from_dict(groups).to_netcdf(engine="h5netcdf")
    write_atomic(path, lambda p: p.write_bytes(content))


def _dataset(columns: dict[str, np.ndarray], axis: str) -> xr.Dataset:
    return xr.Dataset({k: ((axis, "xyz")[: v.ndim], v) for k, v in columns.items()})


def _plain(scan: AttitudeScan) -> dict[str, Any]:
    names = (
        "n_obs",
        "dof",
        "error_known",
        "frame",
        "n_laws",
        "n_periods",
        "left_out",
        "timing",
        "epoch_jd",
        "curve_titles",
        "period_probability",
        "n_ranked",
        "nights",
    )
    about = {k: getattr(scan, k) for k in names}
    about["error_known"] = bool(scan.error_known)
    return about | {"settings": asdict(scan.settings)}


def load_scan(path: Path) -> AttitudeScan:
    """Read a file of `save_scan`.

    Raises
    ------
    InputError
        It is missing or damaged.
    """
    if not path.is_file():
        raise InputError(f"{path} is missing; run `lcbayes scan` again")
    try:
        with xr.open_datatree(path, engine="h5netcdf") as tree:
            return _scan(tree.load())
    except (OSError, ValueError, KeyError, TypeError, RuntimeError) as fault:
        said = (str(fault).splitlines() or [type(fault).__name__])[0]
        raise InputError(f"{path} cannot be read ({said}); run `lcbayes scan` again") from fault


def _scan(tree: xr.DataTree) -> AttitudeScan:
    about = json.loads(tree.attrs[ABOUT])
    asked = about.pop("settings")
    if asked["period_range_h"] is not None:
        asked["period_range_h"] = tuple(asked["period_range_h"])
    settings = Settings(**asked | {"laws": tuple(asked["laws"])})
    light: dict[str, Any] = {
        str(k): v.to_numpy() for k, v in tree["light_curve"].to_dataset().data_vars.items()
    }
    screened = None
    if "screened" in tree:
        screened = Table(**{k: tree["screened"][k].to_numpy() for k in SCREENED})
    sky = None
    if "sky" in tree:
        sky = tree["sky"]["pole"].to_numpy(), tree["sky"]["chi2"].to_numpy()
    nodes = tree["solutions"].children
    solutions = [_solution(nodes[name].to_dataset()) for name in sorted(nodes, key=int)]
    return AttitudeScan(settings, solutions, screened=screened, sky=sky, **light, **about)


def _solution(data: xr.Dataset) -> Solution:
    arrays: dict[str, Any] = {str(k): v.to_numpy() for k, v in data.data_vars.items()}
    return Solution(**json.loads(data.attrs[ABOUT]), **arrays)
