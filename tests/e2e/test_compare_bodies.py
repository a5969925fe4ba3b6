"""Kinds of body compared by evidence, from the files to the page."""

from __future__ import annotations

from pathlib import Path

import pytest

import lcbayes
from lcbayes.cli.main import main
from lcbayes.core.checkpoint import Checkpoint
from lcbayes.core.errors import InputError
from lcbayes.core.progress import Silent
from lcbayes.data.write import write
from lcbayes.inference import body_kind
from lcbayes.inference.body_kind import Kind
from lcbayes.modelling import registry
from lcbayes.results.comparison import summarise
from lcbayes.samplers.settings import Settings
from lcbayes.tasks.compare.options import CompareOptions, kinds_of
from lcbayes.tasks.compare.result import Comparison
from lcbayes.tasks.compare.run import _kinds
from tests.e2e.test_body import BRICK, light_curve
from tests.helpers import small_curves

PLATE = """
title = "a plate that turns end over end"
[body]
shadows = false
spin_axis = [1.0, 0.0, 0.0]
[[body.parts]]
kind = "plate"
x = 2.0
y = 3.0
[materials.paint]
law = "lambertian"
r_diff = { low = 0.1, high = 0.9 }
"""


@pytest.mark.slow
def test_the_brick_is_found_among_bodies(tmp_path: Path, capsys):
    """A brick seen in two passes is neither a plate nor one facet."""
    curve, out = tmp_path / "passes.csv", tmp_path / "out"
    write(light_curve(0, 2), curve)
    (tmp_path / "brick.toml").write_text(BRICK)
    (tmp_path / "plate.toml").write_text(PLATE)
    bodies = [str(tmp_path / "plate.toml"), str(tmp_path / "brick.toml"), "facets:1"]
    arguments = ["compare", str(curve), "--bodies", *bodies, "--set", "omega_sd=0.03"]
    status = main([*arguments, "--num-runs", "2", "--seed", "1", "-o", str(out)])
    assert status in (0, 3)
    said = capsys.readouterr().out
    assert "brick.toml is most probable" in said
    result = lcbayes.load(out)
    assert isinstance(result, Comparison)
    assert list(result.probability) == bodies
    assert result.probability[bodies[1]] > 0.99
    assert result.content["most_probable"] == bodies[1]
    assert list(result.summary()["body"]) == bodies
    assert result.fits[bodies[1]].content["model"] == "body"
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "Kind of body" in page
    assert "brick.toml" in page


def test_kinds_of_body_from_their_names():
    assert kinds_of(["a.toml", "facets:2-3", "plate", "facets:3"]) == [
        ("a.toml", 0),
        ("facets:2", 2),
        ("facets:3", 3),
        ("plate", 0),
    ]


def test_options_go_to_the_bodies_that_have_them():
    options = CompareOptions.of(
        {"bodies": ("box-wing", "facets:2"), "spin": "flat", "omega_sd": "0.02"}
    )
    box, facets = _kinds(options)
    assert (box.entry.name, facets.entry.name) == ("body", "faceted")
    assert (box.n_facets, facets.n_facets) == (0, 2)
    assert box.options["spin"] == "flat"
    assert "spin" not in facets.options
    assert box.options["omega_sd"] == facets.options["omega_sd"] == 0.02


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"bodies": ("plate",)}, "two kinds of body or more"),
        ({"bodies": ("plate", "box-wing"), "n_facets": (2, 3)}, "both given"),
        ({"bodies": ("plate", "box-wing"), "sparse": 8}, "--sparse goes with"),
        ({"bodies": ("plate", "facets:9-99")}, "more than 50 facets"),
        ({"bodies": ("plate", "facets:x")}, "no number or range"),
    ],
)
def test_comparisons_that_are_refused(given, message):
    with pytest.raises(InputError, match=message):
        kinds_of(CompareOptions.of(given).bodies)


def test_option_of_no_body_is_refused():
    options = CompareOptions.of({"bodies": ("plate", "box-wing"), "spin": "torque-free"})
    with pytest.raises(InputError, match="none of the bodies has the option 'spin'"):
        _kinds(options)


@pytest.mark.parametrize(
    "bodies",
    [
        {"facets:1": 1, "one facet": 1},  # which share their compiled programs
        pytest.param({"facets:1": 1, "facets:2": 2}, marks=pytest.mark.slow),
    ],
)
def test_kinds_of_body_from_a_few_draws(bodies):
    """Evidences that are in doubt are kept, and the result says why."""
    curve = small_curves.curve(16)
    entry = registry.find("faceted")
    kinds = [
        Kind(name, entry, entry.check({"n_facets": n, "spin": "none"}), n)
        for name, n in bodies.items()
    ]
    few = Settings(seed=1, num_warmup=20, num_samples=30, num_chains=2, num_starts=8)
    compared = body_kind.run(curve, kinds, few, Checkpoint(None, {}), Silent())
    names = [c.name for c in compared.candidates]
    assert names[0] == "facets:1"
    content, reasons = summarise(compared, {"model": "faceted"}, curve.n_obs, 1)
    assert content["candidates"][0].get("body") == "facets:1"
    assert "evidence-doubtful" in [reason.code for reason in reasons]
    result = Comparison(content | {"trusted": False, "reasons": []}, reasons, {})
    assert list(result.probability) == names
    assert any("facets:1" in line for line in result.lines())
    assert "body" in result.summary()
