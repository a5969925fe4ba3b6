"""Ground floor for everything that uses JAX: double precision, set once, and a compilation cache.

Import ``jax`` and ``jnp`` from here and nowhere else, so that no array is made in single precision
first. The persistent cache spares each new process the seconds it takes to compile a model again;
``LCBAYES_CACHE`` moves it, ``LCBAYES_CACHE=off`` does without.
"""

import os
from pathlib import Path

import jax
import jax.numpy as jnp

__all__ = ["cache_dir", "jax", "jnp"]


def cache_dir() -> Path | None:
    """The folder of the compilation cache, or None when the user turned it off."""
    chosen = os.environ.get("LCBAYES_CACHE")
    if chosen == "off":
        return None
    if chosen:
        return Path(chosen)
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "lcbayes" / "jax"


def _configure() -> None:
    jax.config.update("jax_enable_x64", True)
    folder = cache_dir()
    if folder is None or jax.config.jax_compilation_cache_dir is not None:
        return
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:  # a read-only home: slower, not broken
        return
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)  # small ones are many
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", 0)


_configure()
