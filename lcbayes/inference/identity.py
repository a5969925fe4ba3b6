"""What determines the numerical results of a run, for its checkpoint."""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from lcbayes.core.jax_setup import jax
from lcbayes.data.lightcurve import LightCurve
from lcbayes.modelling.registry import Entry
from lcbayes.samplers.settings import Settings


def digest(curve: LightCurve) -> str:
    """Digest of everything in a light curve that affects numerical results."""
    found = hashlib.sha256()
    for name in (
        "t",
        "brightness",
        "error",
        "sun",
        "obs",
        "range_km",
        "curve",
        "free_scale",
        "exposure_s",
        "position_km",
        "velocity_km_s",
    ):
        value = getattr(curve, name)
        found.update(b"-" if value is None else np.ascontiguousarray(value).tobytes())
    found.update(repr((curve.kind, curve.frame, curve.band.tolist(), curve.site.tolist())).encode())
    return found.hexdigest()


def identity(
    curve: LightCurve, entry: Entry, options: Mapping[str, Any], settings: Settings, version: str
) -> dict[str, Any]:
    """Everything that affects the numerical results of a run, for its checkpoint."""
    code = hashlib.sha256()
    source = getattr(entry.module, "__file__", None)
    if source is not None:
        with open(source, "rb") as file:
            code.update(file.read())
    else:  # a function given in Python
        code.update(function_source(entry.model))
    return {
        "input": digest(curve) + code.hexdigest(),
        "model": entry.name,
        "options": {k: repr(v) for k, v in sorted(options.items())},
        "settings": settings.as_dict(),
        "version": version,
        "jax": jax.__version__,
        "device": jax.default_backend(),
    }


def function_source(function: Callable[..., Any]) -> bytes:
    """The source of a function, or its bytecode if it was not read from a file."""
    try:
        return inspect.getsource(function).encode()
    except (OSError, TypeError):
        code = getattr(function, "__code__", None)
        return (
            repr(function).encode()
            if code is None
            else code.co_code + repr(code.co_consts).encode()
        )
