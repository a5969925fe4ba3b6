"""`lcbayes doctor`."""

from __future__ import annotations

import json
import os
import platform
import sys
import tempfile
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path
from typing import NamedTuple

from lcbayes.core.errors import EXIT_BAD_INPUT, EXIT_DONE
from lcbayes.tasks.doctor.options import DoctorOptions

MIN_PYTHON = (3, 12)
MIN_MEMORY_GIB = 2.0


class Check(NamedTuple):
    """One line of the output; `remedy` is empty if the check passed."""

    name: str
    found: str
    remedy: str = ""


def command(_source: None, options: DoctorOptions) -> int:
    """Print every check; the exit status is 2 if any of them needs attention."""
    checks = list(examine())
    wrong = [check for check in checks if check.remedy]
    if options.json:
        answer = {"ok": not wrong, "checks": [check._asdict() for check in checks]}
        print(json.dumps(answer, indent=1))
    else:
        width = max(len(check.name) for check in checks)
        for check in checks:
            mark = f"  <- {check.remedy}" if check.remedy else ""
            print(f"{check.name:{width}s}  {check.found}{mark}")
        print(f"{len(wrong)} of {len(checks)} checks need attention" if wrong else "all is well")
    return EXIT_BAD_INPUT if wrong else EXIT_DONE


def examine() -> Iterator[Check]:
    """Every check, cheapest first."""
    old = sys.version_info < MIN_PYTHON
    yield Check(
        "python",
        f"{platform.python_version()} ({sys.executable})",
        f"install Python {MIN_PYTHON[0]}.{MIN_PYTHON[1]} or newer" if old else "",
    )
    yield from _packages()
    yield from _jax()
    yield Check("cores", str(_cores()))
    yield _memory()
    yield _data()


def _packages() -> Iterator[Check]:
    """Every dependency of the installed package, compared with the required version."""
    try:
        from packaging.requirements import Requirement
    except ImportError:  # installed with astropy and xarray
        yield Check("packaging", "missing", "run: pip install --force-reinstall lcbayes")
        return
    try:
        yield Check("lcbayes", metadata.version("lcbayes"))
        asked = metadata.requires("lcbayes") or []
    except metadata.PackageNotFoundError:
        yield Check("lcbayes", "not installed", "run: pip install -e . in the checkout")
        return
    for text in asked:
        wanted = Requirement(text)
        if wanted.marker and not wanted.marker.evaluate({"extra": ""}):
            continue
        remedy = f"run: pip install '{wanted.name}{wanted.specifier}'"
        try:
            version = metadata.version(wanted.name)
        except metadata.PackageNotFoundError:
            yield Check(wanted.name, "missing", remedy)
            continue
        fits = wanted.specifier.contains(version, prereleases=True)
        yield Check(wanted.name, version, "" if fits else remedy)


def _jax() -> Iterator[Check]:
    try:
        from lcbayes.core.jax_setup import cache_dir, jax, jnp

        devices = ", ".join(f"{d.platform}:{d.device_kind}" for d in jax.devices())
    except Exception as fault:  # the user must see any fault that prevents JAX from starting
        yield Check(
            "jax devices",
            f"JAX does not start: {fault}".splitlines()[0],
            "reinstall jax and jaxlib",
        )
        return
    yield Check("jax devices", devices)
    double = jnp.ones(1).dtype == "float64" and float(jnp.float64(1) + 2.0**-40) > 1.0
    remedy = "unset JAX_ENABLE_X64, and import jax only through lcbayes"
    yield Check("double precision", "on" if double else "off", "" if double else remedy)
    yield _cache(cache_dir())


def _cache(folder: Path | None) -> Check:
    name = "compilation cache"
    if folder is None:
        return Check(name, "off (LCBAYES_CACHE=off): every run compiles again")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as fault:
        return Check(
            name,
            f"{folder}: {fault.strerror}",
            "point LCBAYES_CACHE at a folder that can be written to, or set it to off",
        )
    return Check(name, f"{folder} (writable)")


def _cores() -> int:
    """Number of cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _memory() -> Check:
    try:
        gib = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    except (AttributeError, ValueError, OSError):
        return Check("memory", "unknown")
    remedy = f"fits need some {MIN_MEMORY_GIB:g} GiB" if gib < MIN_MEMORY_GIB else ""
    return Check("memory", f"{gib:.1f} GiB", remedy)


def _data() -> Check:
    """Real observations for the tests; optional."""
    chosen = os.environ.get("LCBAYES_DATA")
    if not chosen:
        return Check("observations for tests", "LCBAYES_DATA is not set (only tests use it)")
    if Path(chosen).is_dir():
        return Check("observations for tests", chosen)
    return Check(
        "observations for tests",
        f"{chosen} is not a folder",
        "correct LCBAYES_DATA, or unset it: only tests use it",
    )
