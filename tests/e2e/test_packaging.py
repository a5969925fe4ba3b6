"""What users install: the wheel and the sdist, built without the checkout's links, and used."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import zipfile
from pathlib import Path

import pytest

from lcbayes.data.write import write
from tests.helpers import small_curves

ROOT = Path(__file__).resolve().parents[2]
SHIPPED = ("pyproject.toml", "LICENSE", "README.md", "lcbayes", "models", "analysis")
BALL = """
import numpyro
import numpyro.distributions as dist
from lcbayes.modelling import likelihood

def model(data):
    size = numpyro.sample("size", dist.LogNormal(0.0, 1.0))
    likelihood.observe(data, size * (1.0 + data.phase_angle))
"""
CLI_MISSING = not (ROOT / "lcbayes" / "cli" / "main.py").exists()


def _run(command: list[str | Path], cwd: Path, ok: tuple[int, ...] = (0,)) -> str:
    env = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "VIRTUAL_ENV"))}
    done = subprocess.run(
        list(map(str, command)), cwd=cwd, env=env, capture_output=True, text=True, timeout=600
    )
    assert done.returncode in ok, f"exit {done.returncode}\n{done.stdout}\n{done.stderr}"
    return done.stdout


@pytest.fixture(scope="module")
def dist(tmp_path_factory) -> Path:
    """A folder with an sdist, and with the wheel built from that sdist."""
    source = tmp_path_factory.mktemp("source")
    for name in SHIPPED:
        if (ROOT / name).is_dir():
            # The links lcbayes/models and lcbayes/analysis are for checkouts: an archive or a
            # checkout without links must give the same package.
            shutil.copytree(
                ROOT / name,
                source / name,
                ignore=lambda folder, names: [
                    n for n in names if n == "__pycache__" or (Path(folder) / n).is_symlink()
                ],
            )
        else:
            shutil.copy(ROOT / name, source / name)
    assert not (source / "lcbayes" / "models").exists()
    _run([sys.executable, "-m", "build", "--no-isolation"], cwd=source)
    return source / "dist"


@pytest.fixture(scope="module")
def wheel(dist) -> Path:
    (path,) = dist.glob("*.whl")
    return path


def _expected() -> set[str]:
    """Every file of the checkout that belongs into the package, under its installed name."""
    names = set()
    for top, prefix in (("lcbayes", ""), ("models", "lcbayes/"), ("analysis", "lcbayes/")):
        for path in (ROOT / top).rglob("*"):
            name = path.relative_to(ROOT).as_posix()
            skipped = "__pycache__" in name or name.startswith(
                ("lcbayes/models", "lcbayes/analysis", "analysis/papers")
            )
            if path.is_file() and not skipped:
                names.add(prefix + name)
    return names


def test_wheel_holds_the_package_and_nothing_else(wheel):
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
    info = {name for name in names if ".dist-info/" in name}
    assert {name.split("/")[0] for name in names - info} == {"lcbayes"}
    assert any(name.endswith("licenses/LICENSE") for name in info)
    assert {"lcbayes/py.typed", "lcbayes/models/__init__.py"} <= names
    assert names - info == _expected()


def test_sdist_builds_alone(dist):
    (path,) = dist.glob("*.tar.gz")
    with tarfile.open(path) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    assert {"pyproject.toml", "LICENSE", "README.md", "lcbayes/py.typed"} <= names
    assert {"models/__init__.py", "analysis/__init__.py"} <= names
    assert not any(name.startswith("tests") for name in names)


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory) -> Path:
    """The bin folder of an environment that holds the wheel and, of this one, only dependencies.

    Downloading JAX again would take a minute. The line in a .pth file adds this environment's
    packages to the search path without running *its* .pth files, so an editable lcbayes stays out.
    """
    folder = tmp_path_factory.mktemp("empty") / "env"
    _run([sys.executable, "-m", "venv", "--without-pip", folder], cwd=folder.parent)
    python = folder / "bin" / "python"
    install = [sys.executable, "-m", "pip", "--python", python, "install", "--quiet"]
    _run([*install, "--no-index", "--no-deps", wheel], cwd=folder.parent)
    (site,) = folder.glob("lib/python3.*/site-packages")
    (site / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    where = _run([python, "-c", "import lcbayes; print(lcbayes.__file__)"], cwd=folder.parent)
    assert Path(where.strip()).is_relative_to(folder)
    return folder / "bin"


def test_installed_modules_import(installed, tmp_path):
    code = "import lcbayes.models, lcbayes.analysis, lcbayes.physics.brightness, lcbayes.simulation"
    _run([installed / "python", "-c", code], cwd=tmp_path)


@pytest.mark.skipif(CLI_MISSING, reason="lcbayes/cli/main.py is not there yet")
def test_help_from_another_folder(installed, tmp_path):
    answer = _run([installed / "lcbayes", "--help"], cwd=tmp_path)
    for command in ("simulate", "fit", "doctor"):
        assert command in answer


@pytest.mark.skipif(CLI_MISSING, reason="lcbayes/cli/main.py is not there yet")
@pytest.mark.parametrize(
    "model",
    [
        ("--model", "ball.py"),  # compiled in a few seconds
        pytest.param(("--n-facets", "1", "--spin", "none"), marks=pytest.mark.slow),
    ],
)
def test_a_tiny_fit_from_another_folder(installed, tmp_path, model):
    lcbayes = installed / "lcbayes"
    _run([lcbayes, "simulate", "one-facet", "-o", "simulated.csv", "--seed", "1"], cwd=tmp_path)
    assert (tmp_path / "simulated.csv").stat().st_size > 0
    write(small_curves.curve(20), tmp_path / "c.csv")
    (tmp_path / "ball.py").write_text(BALL)
    asked = [*model, *small_curves.SHORT_RUN, "--seed", "1"]
    _run([lcbayes, "fit", "c.csv", "-o", "out", *asked], cwd=tmp_path, ok=(0, 3))
    for name in ("posterior.nc", "summary.json", "report.html", "run.toml"):
        assert (tmp_path / "out" / name).stat().st_size > 0
