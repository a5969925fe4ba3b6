"""Bodies of parts in scenario files: what is read, what is refused, and the truth of a curve."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jnp
from lcbayes.physics.attitude.laws import Ephemeris
from lcbayes.simulation.observability.measurements import measure
from lcbayes.simulation.scenarios.scenario import load
from lcbayes.simulation.simulate import predicted_flux, simulate
from tests.helpers import shaded_bodies as shaded

CUBE = '[[body.parts]]\nkind = "box"\nx = 1\ny = 1\nz = 1\nmaterial = "white"\n'
LAW = 'law = "fixed"'


@pytest.fixture
def write(tmp_path):
    def save(text: str):
        path = tmp_path / "s.toml"
        path.write_text(text + shaded.REST, encoding="utf-8")
        return path

    return save


def test_a_box_of_parts_is_the_box_among_the_shapes(write):
    parts = load(write(CUBE))
    shape = load(write('[body]\nshape = "cube"\nside = 1\nmaterial = "white"\n'))
    (_, truth), (_, other) = simulate(parts, 1), simulate(shape, 1)
    assert truth["flux"] == pytest.approx(other["flux"], rel=1e-12)
    assert max(other["flux"]) > 0.1
    assert parts.parts is not None
    assert parts.parts.method == "none"


def test_materials_of_sides(write):
    body = load(write(shaded.STAGE.replace("TOLERANCE", "1e-2"))).body
    assert {label for label, u in zip(body.labels, body.normals, strict=True) if u[2] > 0.99} == {
        "grey",
        "white",
    }
    assert body.labels.count("grey") == 2
    wing = load(write(shaded.WINGS)).body
    assert wing.labels == ("white",) * 6 + ("grey", "white") * 2
    np.testing.assert_allclose(wing.normals[6], [1, 0, 0], atol=1e-15)
    np.testing.assert_allclose(np.abs(wing.u_axes[6]), [0, 1, 0], atol=1e-15)


def test_materials_of_a_mesh_are_those_of_its_groups(write, tmp_path):
    corners = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 0 1\n"
    (tmp_path / "m.obj").write_text(corners + "g grey\nf 1 2 3\ng other\nf 1 2 4\n")
    text = '[[body.parts]]\nkind = "mesh"\nfile = "m.obj"\nscale = 2\nmaterial = "white"\n'
    body = load(write(text)).body
    assert body.labels == ("grey", "white")
    np.testing.assert_allclose(body.areas, 2.0)


def test_the_truth_names_the_parts(write):
    _, truth = simulate(load(write(shaded.WINGS)), 3)
    truth = json.loads(json.dumps(truth))
    assert [part["kind"] for part in truth["parts"]] == ["box", "plate", "plate"]
    assert truth["parts"][1]["position_m"] == [0, 2.1, 0]
    assert truth["parts"][1]["sizes"] == {"x": 3.0, "y": 1.2}
    assert truth["parts"][1]["materials"] == ["grey", "white"]
    assert truth["parts"][0]["area_m2"] == pytest.approx(2 * (1.8 + 3.0 + 2.4))
    assert np.array(truth["parts"][0]["rotation"]).tolist() == np.eye(3).tolist()
    assert truth["shadows"] == {"method": "exact", "flux_error": 0.0}
    assert "facets" not in truth
    whole = load(write(shaded.WINGS.replace("[[body", "[body]\nshadows = false\n[[body", 1)))
    assert simulate(whole, 3)[1]["shadows"]["method"] == "none"


def test_simulated_flux_is_that_of_the_turned_body(write):
    """The attitude law turns the directions before shadows are found; exposures are averaged."""
    turning = 'law = "constant-rate"\nomega_rad_s = [0.02, 0.1, -0.05]'
    path = write(shaded.WINGS)
    path.write_text(path.read_text().replace(LAW, turning))
    scenario = load(path)
    sun, obs = shaded.attitudes(7, 12)
    along = Ephemeris(jnp.linspace(0.0, 20.0, 7), jnp.asarray(sun))
    rotation = np.asarray(scenario.attitude.frames(along).body)
    turned = [np.einsum("tji,tj->ti", rotation, v) for v in (sun, obs)]
    result = np.asarray(predicted_flux(scenario, along, jnp.asarray(obs)))
    assert result == pytest.approx(shaded.flux(scenario, *turned), abs=1e-12)
    exposed = predicted_flux(replace(scenario, exposure_s=1e-3), along, jnp.asarray(obs))
    assert np.asarray(exposed) == pytest.approx(result, abs=1e-4)


def test_shadows_by_points_are_averaged_over_an_exposure(tmp_path):
    scenario = shaded.scenario("mesh", tmp_path)
    sun, obs = shaded.attitudes(3, 13)
    along = Ephemeris(jnp.arange(3.0), jnp.asarray(sun))
    whole = np.asarray(predicted_flux(scenario, along, jnp.asarray(obs)))
    exposed = predicted_flux(replace(scenario, exposure_s=1.0), along, jnp.asarray(obs))
    assert np.asarray(exposed) == pytest.approx(whole, rel=1e-12)  # the body is at rest


ARRAY = """[[body.parts]]
kind = "plate"
x = 1
y = 1
material = "white"
on_array = true
"""


def test_parts_on_an_array_turn_with_it(write):
    path = write("[body]\nshadows = false\n" + ARRAY + CUBE)
    path.write_text(path.read_text().replace(LAW, 'law = "nadir-sun-array"'))
    assert load(path).on_array == (True,) * 2 + (False,) * 6


def test_observability_refuses_bodies_that_shade_themselves(write):
    with pytest.raises(InputError, match=r"shade each other .*shadows = false"):
        measure(load(write(shaded.WINGS)))


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        (
            CUBE.replace("box", "cube"),
            "line 2: body.parts.1..kind is 'cube'; expected one of: box, plate",
        ),
        (
            CUBE.replace("x = 1", "x = -1"),
            "line 3: body.parts.1..x is -1; expected a number >= 1e-06",
        ),
        (CUBE.replace("x = 1\n", ""), "body.parts.1. has no 'x'"),
        (CUBE + "radius = 1\n", "line 7: body.parts.1..radius is not a key"),
        (CUBE + "direction = [0, 0, 0]\n", "line 7: .*direction has length zero"),
        (CUBE + "direction = [0, 0, 1]\nrotation_deg = [0, 0, 1]\n", "exclude each other"),
        (CUBE + "position = [0, 0, 1e7]\n", "position is .* from -1e.06 to 1e.06"),
        (CUBE + 'end_material = "grey"\n', "end_material is not a key"),
        (CUBE.replace("white", "red"), "material is 'red'; expected one of: white, grey"),
        (CUBE.replace('material = "white"\n', ""), "has no 'material'"),
        ("[body]\nparts = []\n", "parts is empty; give at least one"),
        ('[body]\nshape = "cube"\n' + CUBE, "has 'parts' and 'shape'; give one of them"),
        (
            '[body]\nshape = "cube"\nmaterial = "white"\nshadows = true\n',
            "shadows needs places; give",
        ),
        ("[body]\ntolerance = 1.0\n" + CUBE, "tolerance is 1.0; expected a number >= 1e-06"),
        (ARRAY, "shadows needs a rigid body, and a part has on_array"),
        (
            '[[body.parts]]\nkind = "mesh"\nmaterial = "white"\nfile = "none.obj"\n',
            "none.obj does not",
        ),
        (
            '[[body.parts]]\nkind = "sphere"\nradius = 1\nmaterial = "mirror"\n[materials.mirror]\n'
            'law = "blinn-phong"\nr_diff = 0\nr_spec = 0.9\nn = 1e6\n',
            "line 1: body.parts.1. is so glossy that .* panels leave an error of",
        ),
    ],
)
def test_faults(text, fault, write):
    with pytest.raises(InputError, match=fault) as caught:
        load(write(text))
    assert "\n" not in str(caught.value)
    assert "s.toml" in str(caught.value) or "none.obj" in str(caught.value)
