"""The reference posteriors as written by `make.py`."""

from __future__ import annotations

import hashlib
import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from tests.reference.agreement import Moments
from tests.reference.problems import Reference

WRITTEN = Path(__file__).with_name("posteriors.json")


@cache
def everything() -> dict[str, Any]:
    return json.loads(WRITTEN.read_text(encoding="utf-8"))


def identity(one: Reference) -> dict[str, Any]:
    """Whose posterior it is: the model, its options, and everything in the curve."""
    return {
        "model": Path(one.model).name,
        "options": one.options,
        "n_obs": one.curve.n_obs,
        "curve": _digest(one),
    }


def _digest(one: Reference) -> str:
    """Of the numbers that the posterior rests on, to nine digits."""
    curve, result = one.curve, hashlib.sha256()
    for values in (curve.t, curve.brightness, curve.error, curve.sun, curve.obs):
        result.update(
            b"-" if values is None else str([f"{x:.9g}" for x in values.ravel()]).encode()
        )
    return result.hexdigest()[:16]


def moments(name: str, of: str = "") -> Moments:
    """Those to compare with, or ``of`` = "nuts_": those of the long chains beside them."""
    rows = everything()["problems"][name]["quantities"]
    mean, sd, mean_se, sd_se = (
        np.array([row[of + key] for row in rows.values()])
        for key in ("mean", "sd", "mean_se", "sd_se")
    )
    return Moments(tuple(rows), mean, sd, mean_se, sd_se / sd)
