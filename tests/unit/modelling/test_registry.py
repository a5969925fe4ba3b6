"""Model files: found, checked, and their faults told in one line."""

from __future__ import annotations

from dataclasses import replace

import pytest

from lcbayes.core.errors import InputError
from lcbayes.modelling import registry
from lcbayes.samplers.settings import Settings

GOOD = """
SUMMARY = "mine"
FACET_SITES = ("a",)

def model(data, *, depth: float, count: int = 2, dark: bool = False, law: str = "x"):
    "Docs."
"""


@pytest.fixture
def mine(tmp_path):
    def write(text: str, name: str = "mine.py"):
        (tmp_path / name).write_text(text)
        return str(tmp_path / name)

    return write


def test_a_users_file(mine):
    entry = registry.find(mine(GOOD))
    assert (entry.summary, entry.facet_sites, entry.hook("starts")) == ("mine", ("a",), None)
    assert {k: (o.type, o.required) for k, o in entry.options.items()} == {
        "depth": (float, True),
        "count": (int, False),
        "dark": (bool, False),
        "law": (str, False),
    }
    checked = entry.check({"depth": "0.5", "count": "3", "dark": "true"})
    assert checked == {"depth": 0.5, "count": 3, "dark": True}
    assert entry.check({"depth": 1, "count": 3.0})["count"] == 3


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({}, "needs 'depth'; give it with --depth"),
        ({"depth": "deep"}, "is 'deep'; expected float"),
        ({"depth": "nan"}, "is 'nan'; expected float"),
        ({"depth": 1, "count": "2.5"}, "is '2.5'; expected int"),
        ({"depth": 1, "count": "inf"}, "is 'inf'; expected int"),
        ({"depth": 1, "dark": "maybe"}, "is 'maybe'; expected bool"),
        ({"depth": 1, "colour": 1}, "no option 'colour'; available: depth, count, dark, law"),
    ],
)
def test_options_are_checked(mine, given, says):
    with pytest.raises(InputError, match=says) as fault:
        registry.find(mine(GOOD)).check(given)
    assert "\n" not in str(fault.value)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("def model(data:\n", "line 1: SyntaxError"),
        ("x = 1\nimport nothing_of_that_name\n", "line 2: ModuleNotFoundError"),
        ("x = 1\n", "defines no function model"),
        ("model = 3\n", "defines no function model"),
        ("def model(data, depth=1.0): ...\n", "must take data alone by position"),
        ("def model(*, depth=1.0): ...\n", "must take data alone by position"),
        ("def model(data, *, depth): ...\n", "the option 'depth' needs a type"),
        ("def model(data, *, depth: list = 1): ...\n", "the option 'depth' needs a type"),
        ("def model(data, *, depth=None): ...\n", "the option 'depth' needs a type"),
        ("def model(data, *, depth: 'Nothing' = 1): ...\n", "Nothing"),
        ("model = dict\n", "model has no signature"),
        ("raise ValueError('a\\nb\\nc')\n", "line 1: ValueError: a b c; the file must run"),
        ("import sys; sys.exit(0)\n", "line 1: SystemExit: 0; the file must run"),
    ],
)
def test_a_file_that_breaks_the_contract(mine, text, says):
    with pytest.raises(InputError, match=says) as fault:
        registry.find(mine(text))
    assert "\n" not in str(fault.value)
    assert "mine.py" in str(fault.value)


def test_names_and_paths_that_are_none(tmp_path):
    with pytest.raises(
        InputError,
        match=r"unknown model 'convex' \(did you mean convex-grid\?\); available: faceted, ",
    ):
        registry.find("convex")
    with pytest.raises(InputError, match="does not exist"):
        registry.find(str(tmp_path / "none.py"))
    with pytest.raises(InputError, match="does not exist"):
        registry.find(str(tmp_path))
    (tmp_path / "notes.txt").write_text("no Python")
    with pytest.raises(InputError, match="no Python file; give one"):
        registry.find(str(tmp_path / "notes.txt"))


def test_faults_while_it_runs_name_file_and_line(mine):
    entry = registry.find(mine("def model(data):\n    x = 1\n    return data.nonsense\n"))
    with pytest.raises(InputError, match=r"mine\.py, line 3: AttributeError"), entry.blamed():
        entry.bind({})(object())
    entry = registry.find(mine("import sys\ndef model(data):\n    sys.exit(0)\n"))
    with pytest.raises(InputError, match=r"mine\.py, line 3: SystemExit"), entry.blamed():
        entry.bind({})(object())
    with pytest.raises(InputError, match="as it is"), entry.blamed():
        raise InputError("as it is")


def test_faults_of_a_built_in_model_are_not_the_users():
    entry = registry.find("faceted")
    with pytest.raises(InputError, match="unknown law"), entry.blamed():
        raise ValueError("unknown law")
    with pytest.raises(ZeroDivisionError), entry.blamed():
        raise ZeroDivisionError


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (
            {"sampler": "gibbs"},
            "unknown sampler 'gibbs'; available: auto, nuts, facet-moves, guided",
        ),
        ({"num_samples": 9}, "--num-samples is 9; give a whole number >= 10"),
        ({"num_warmup": 0}, "--num-warmup is 0"),
        ({"num_chains": 0}, "--num-chains is 0"),
        ({"num_chains": 2.0}, r"--num-chains is 2\.0"),
        ({"max_modes": 0}, "--max-modes is 0"),
        ({"num_starts": -1}, "--num-starts is -1"),
        ({"seed": -1}, "--seed is -1"),
    ],
)
def test_settings_are_checked(change, says):
    with pytest.raises(InputError, match=says):
        replace(Settings(), **change)


def test_settings_as_a_table():
    assert Settings(**Settings(seed=4).as_dict()) == Settings(seed=4)
