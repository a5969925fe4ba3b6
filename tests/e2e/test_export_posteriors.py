"""Exported posteriors: their layout, and a density that is that of the fit."""

from __future__ import annotations

import importlib.util
import json
import sys
import zipfile
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.inference.problem_cache import build_problem
from lcbayes.modelling import registry
from lcbayes.modelling.epochs import Epochs

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"
DRAWS = 60


def module(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    result = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = result  # dataclasses look it up
    spec.loader.exec_module(result)
    return result


def unzipped(path: Path) -> Any:
    with zipfile.ZipFile(path) as archive:
        (name,) = archive.namelist()
        assert f"{name}.zip" == path.name
        return json.loads(archive.read(name))


@pytest.mark.slow
def test_the_ridge(tmp_path: Path) -> None:
    export = module(BENCHMARKS / "export_posteriors.py")
    export.export(tmp_path, "ridge", draws=DRAWS, num_chains=4, num_samples=750)
    posterior = json.loads((tmp_path / "posteriors" / "ridge-lcbayes_faceted.json").read_text())
    assert posterior["dimensions"] == {"log_albedo_area": 1, "normals_base": 3}
    reference = posterior["reference_posterior_name"]
    folder = tmp_path / "reference_posteriors" / "draws"
    info = json.loads((folder / "info" / f"{reference}.info.json").read_text())
    assert info["checks_made"]["trusted_by_lcbayes"]
    chains = unzipped(folder / "draws" / f"{reference}.json.zip")
    assert len(chains) == info["diagnostics"]["nchains"] == export.CHAINS
    assert {len(v) for chain in chains for v in chain.values()} == {DRAWS}

    data = unzipped(tmp_path / "data" / "data" / "ridge.json.zip")
    density = module(tmp_path / "models" / "jax" / f"{posterior['model_name']}.py").Posterior(data)
    assert density.dim == posterior["unconstrained_dimension"] == 4
    first = {name: np.array([values[0]]) for name, values in chains[0].items()}
    base = [first[f"normals_base[1,{k}]"][0] for k in (1, 2, 3)]
    sites = {"log_albedo_area": first["log_albedo_area[1]"], "normals_base": np.array([base])}
    z = density.unconstrain(sites)
    again = density.constrain(z)
    for name, values in sites.items():
        np.testing.assert_allclose(again[name], values, rtol=1e-6)
    value, slope = jax.value_and_grad(density.logdensity_fn)(z)
    assert np.isfinite(value)
    assert np.isfinite(slope).all()

    # the density is that of an independent formula: the draws scatter about their mean as it says
    draws = np.array([[np.ravel(x) for x in chain["log_albedo_area[1]"]] for chain in chains])
    assert abs(draws.mean() - np.log(10.0)) < 0.3  # the facet has 10 m²
    higher = density.logdensity_fn(density.unconstrain(sites | {"log_albedo_area": jnp.zeros(1)}))
    assert higher < value - 10.0  # a tenth of the area explains nothing


@pytest.mark.slow
@pytest.mark.parametrize("name", ["mirror", "glint", "tumbler", "ariadne"])
def test_the_density_of_the_files_is_that_of_the_light_curve(tmp_path, monkeypatch, name) -> None:
    """The model is built from the exported files, and from the light curve that never was one."""
    monkeypatch.syspath_prepend(BENCHMARKS)
    export = module(BENCHMARKS / "export_posteriors.py")
    if name == "ariadne" and not (export.DATA / "damit").is_dir():
        pytest.skip("no real data")
    one, power = export.POSTERIORS[name], 0.7
    curve = one.make()
    export._write_data(tmp_path, name, one, curve, power)
    export._write_model(tmp_path, one)
    data = unzipped(tmp_path / "data" / "data" / f"{name}.json.zip")
    density = module(tmp_path / "models" / "jax" / f"{one.model_name}.py").Posterior(data)

    entry = registry.find(one.model)
    epochs = replace(Epochs.of(curve), information=jnp.asarray(power))
    problem, _ = build_problem(entry, entry.check(dict(one.options)), epochs)
    assert density.dim == problem.dim
    values = []
    for key in jax.random.split(jax.random.key(3), 4):
        z = problem.prior_draw(key, epochs)
        value, slope = jax.value_and_grad(density.logdensity_fn)(z)
        assert np.isfinite(slope).all()
        assert value == pytest.approx(-float(problem.potential(z, epochs)), rel=1e-6)
        values.append(value)
        sites = density.constrain(z)
        assert density.unconstrain(sites) == pytest.approx(np.asarray(z), abs=1e-8)
    assert np.ptp(values) > 1.0


def test_an_unknown_name_is_refused() -> None:
    export = module(BENCHMARKS / "export_posteriors.py")
    with pytest.raises(SystemExit, match=r"usage: .*ridge"):
        export.main(["out", "none"])
