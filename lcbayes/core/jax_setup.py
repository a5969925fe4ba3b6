"""JAX set-up: double precision and a persistent compilation cache.

Import ``jax`` and ``jnp`` only from here, so that no array is created in single precision. With
the persistent cache a new process need not compile a model again, which takes seconds.
``LCBAYES_CACHE`` sets its folder, ``LCBAYES_CACHE=off`` disables it.
"""

import os
from pathlib import Path

import jax
import jax.numpy as jnp

__all__ = ["cache_dir", "jax", "jnp"]


def cache_dir() -> Path | None:
    """The folder of the compilation cache, or None if the user disabled it."""
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
    except OSError:  # a read-only home folder: work without a cache
        return
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)  # many are small
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", 0)


_configure()
