#!/usr/bin/env -S uv run --script
# /// script
# dependencies = ["nox>=2025.2.9"]
# ///
"""The checks of the Makefile, in a separate environment for each Python version.

nox              lint, and the tests on every supported version that is installed
nox -s docs      the documentation
"""

from __future__ import annotations

import nox

nox.needs_version = ">=2025.2.9"
nox.options.default_venv_backend = "uv|virtualenv"
nox.options.error_on_missing_interpreters = False


@nox.session(python="3.12", default=True)
def lint(session: nox.Session) -> None:
    """Run ruff and pyright."""
    session.install("-e", ".[dev]")
    session.run("ruff", "check", ".")
    session.run("ruff", "format", "--check", ".")
    session.run("pyright", "--pythonpath", f"{session.bin}/python")


@nox.session(python=["3.12", "3.13", "3.14"], default=True)
def tests(session: nox.Session) -> None:
    """Run the tests without the long statistical ones; further arguments go to pytest."""
    session.install("-e", ".[dev]")
    env = {"OPENBLAS_NUM_THREADS": "1"}
    session.run("pytest", "-m", "not slow", *session.posargs, env=env)


@nox.session(python="3.12", default=False)
def docs(session: nox.Session) -> None:
    """Build the documentation site, with every warning an error."""
    session.install("-e", ".[docs]")
    session.run("python", "docs/make_gallery.py")
    session.run("sphinx-build", "-b", "html", "-q", "-W", "docs", "docs/_build/html")


if __name__ == "__main__":
    nox.main()
