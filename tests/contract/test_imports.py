"""The architecture: which room may import from which."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from runpy import run_path

import pytest

ROOT = Path(__file__).resolve().parents[2]

# The rooms of the house from the ground up: a room imports only from rooms before it.
ROOMS = (
    "core",
    "geometry",
    "data",
    "physics",
    "modelling",
    "simulation",
    "samplers",
    "inference",
    "inversion",
    "results",
    "models",
    "analysis",
    "tasks",
    "cli",
)
OUTSIDE = ("models", "analysis")  # installed into the package, but not of its twelve rooms
AT_THE_TOP = {"__init__.py", "__main__.py", "py.typed"}
JAX = "lcbayes.core.jax_setup"
HEAVY = ("jax", "numpyro", "arviz", "astropy", "matplotlib", "scipy", "pandas", "xarray")


def _modules() -> dict[str, Path]:
    """Every installed module of the project by its dotted name, each file once."""
    result = {}
    places = {"lcbayes": "lcbayes", "models": "lcbayes.models", "analysis": "lcbayes.analysis"}
    for top, package in places.items():
        for path in sorted((ROOT / top).rglob("*.py")):
            relative = path.relative_to(ROOT / top)
            if top == "lcbayes" and relative.parts[0] in ("models", "analysis"):
                continue  # links
            if top == "analysis" and relative.parts[0] == "papers":
                continue  # scripts, not installed
            parts = [*package.split("."), *relative.with_suffix("").parts]
            result[".".join(parts).removesuffix(".__init__")] = path
    return result


MODULES = _modules()


def _room(module: str) -> str | None:
    """The room of a module; None for the front door, which may import from all of them."""
    second = module.split(".")[1] if "." in module else "__main__"
    return None if second == "__main__" else second


@cache
def _imports(module: str) -> tuple[tuple[str, int], ...]:
    """(dotted name, line) of everything a module imports, also inside functions.

    `from a import b` counts as `a.b` where that is a module of the project, else as `a`.
    """
    path = MODULES[module]
    tree = ast.parse(path.read_text(encoding="utf-8"))
    package = module if path.name == "__init__.py" else module.rpartition(".")[0]
    result: list[tuple[str, int]] = []
    for node in _walk(tree):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                parents = package.split(".")[: len(package.split(".")) - node.level + 1]
                base = ".".join([*parents, *([base] if base else [])])
            names = [
                f"{base}.{alias.name}" if f"{base}.{alias.name}" in MODULES else base
                for alias in node.names
            ]
        else:
            continue
        result += [(name, node.lineno) for name in names]
    return tuple(result)


def _walk(node: ast.AST) -> Iterator[ast.AST]:
    """Every node but those under `if TYPE_CHECKING:`, which never run."""
    yield node
    if isinstance(node, ast.If) and ast.unparse(node.test).endswith("TYPE_CHECKING"):
        children = iter(node.orelse)
    else:
        children = ast.iter_child_nodes(node)
    for child in children:
        yield from _walk(child)


def _ours(name: str) -> bool:
    return name == "lcbayes" or name.startswith("lcbayes.")


def test_the_rooms_are_those_of_the_plan():
    result = {p.name for p in (ROOT / "lcbayes").iterdir() if p.name != "__pycache__"}
    assert result == AT_THE_TOP | set(ROOMS)
    assert len(set(ROOMS) - set(OUTSIDE)) <= 12


@pytest.mark.parametrize("room", ROOMS)
def test_a_room_says_what_it_is_for(room):
    doc = ast.get_docstring(ast.parse(MODULES[f"lcbayes.{room}"].read_text(encoding="utf-8")))
    assert doc
    assert f"| `{room}` |" in (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")


def _place(module: str, line: int) -> str:
    return f"{MODULES[module].relative_to(ROOT)}:{line}"


def test_a_module_imports_only_from_rooms_below():
    wrong = []
    for module in MODULES:
        room = _room(module)
        if room is None:
            continue
        below = ROOMS[: ROOMS.index(room) + 1]
        wrong += [
            f"{_place(module, line)} ({room}) imports {name}"
            for name, line in _imports(module)
            if _ours(name) and _room(name) not in below
        ]
    assert not wrong, "\n".join(wrong)


def test_the_picture_shows_these_rooms():
    picture = run_path(str(ROOT / "docs" / "make_architecture.py"))
    assert picture["ROOMS"] == ROOMS


def test_no_circles():
    graph = {
        module: {
            name
            for name, _ in _imports(module)
            if name in MODULES and name != module and name != "lcbayes"
        }
        for module in MODULES
    }
    done: set[str] = set()

    def walk(module: str, trail: tuple[str, ...]) -> None:
        assert module not in trail, " -> ".join([*trail[trail.index(module) :], module])
        if module not in done:
            for name in sorted(graph[module]):
                walk(name, (*trail, module))
            done.add(module)

    for module in graph:
        walk(module, ())


def test_jax_comes_through_the_ground_floor():
    """An array made before double precision is set would stay in single precision."""
    wrong = []
    for module in MODULES:
        if module == JAX:
            continue
        result = _imports(module)
        wrong += [
            f"{_place(module, line)} imports {name}: take jax and jnp from {JAX}"
            for name, line in result
            if name in ("jax", "jax.numpy")
        ]
        of_jax = [line for name, line in result if name.split(".")[0] == "jax"]
        if of_jax and JAX not in (name for name, _ in result):
            wrong.append(f"{_place(module, of_jax[0])} imports JAX without {JAX}")
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("module", ["lcbayes", "lcbayes.cli.main"])
def test_the_front_door_is_light(module):
    """`lcbayes --help` answers at once: nothing heavy is imported until a command needs it."""
    if module not in MODULES:
        pytest.skip(f"{module} is not there yet")
    code = f"import sys, {module}; print(*[m for m in {HEAVY!r} if m in sys.modules])"
    answer = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert answer.stdout.split() == []


@pytest.mark.parametrize(
    "begin",
    [
        "import arviz; import lcbayes.modelling.problem",
        pytest.param("import lcbayes, arviz; lcbayes.fit", marks=pytest.mark.slow),
    ],
)
def test_arviz_may_be_imported_before(begin):
    """ArviZ loads NumPyro lazily, and NumPyro's submodules do not take that well."""
    script = f"{begin}; import numpyro; numpyro.distributions.distribution"
    subprocess.run([sys.executable, "-c", script], check=True, cwd=ROOT)
