"""Reference posteriors in the layout of posteriordb, with log densities in JAX.

    python benchmarks/export_posteriors.py DIR           all of them
    python benchmarks/export_posteriors.py DIR ridge     or mirror, glint, tumbler, ariadne

For each posterior NAME, DIR receives

    posteriors/NAME-MODEL.json          dimensions, and names of the following
    data/data/NAME.json.zip             light curve, model and options
    data/info/NAME.info.json
    models/jax/MODEL.py                 logdensity_fn, constrain and unconstrain, with lcbayes
    models/info/MODEL.info.json
    reference_posteriors/draws/
        draws/NAME-MODEL.json.zip       10 × 1000 draws of the sampled sites
        info/NAME-MODEL.info.json       sampler, R-hat, effective sizes, checks

The draws are those of `lcbayes.fit`: NUTS in each solution, weighted by the evidence. A posterior
whose fit is not trusted gets no reference draws, and its entry says why.

References
----------
Magnusson et al. 2024, posteriordb, arXiv:2407.04967.
"""

from __future__ import annotations

import json
import os
import sys
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np

import lcbayes
from lcbayes.core.progress import Console
from lcbayes.core.version import installed_version
from lcbayes.data.formats.written import columns_of, meta_of
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inference.problem_cache import build_problem
from lcbayes.modelling import registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.simulation.scenarios import scenario
from lcbayes.simulation.simulate import simulate

HERE = Path(__file__).parent
DATA = Path(os.environ.get("LCBAYES_DATA", HERE.parents[1] / "shared" / "data"))
NOISE_SEED = 1
CHAINS, DRAWS = 10, 1000  # as posteriordb asks for
SAMPLED = 14  # chains of at least 750 draws each, extended until they have converged
DIGITS = 8  # significant digits of the draws

DENSITY = '''\
"""Log density of a posterior of lcbayes, in JAX: needs ``pip install lcbayes``.

    import json, zipfile
    with zipfile.ZipFile("data/data/NAME.json.zip") as archive:
        data = json.loads(archive.read("NAME.json"))
    posterior = Posterior(data)
    posterior.logdensity_fn(z)       # of the unconstrained vector z, (posterior.dim,)
    posterior.constrain(z)           # the sites, as in the reference draws
    posterior.unconstrain(sites)     # z
"""

from dataclasses import replace

import jax
import pandas as pd

import lcbayes
from lcbayes.inference.problem_cache import build_problem
from lcbayes.modelling import registry
from lcbayes.modelling.epochs import Epochs


class Posterior:
    def __init__(self, data):
        table = pd.DataFrame(data["light_curve"])
        table.attrs.update(data["meta"])
        power = jax.numpy.asarray(data["information"])
        self.epochs = replace(Epochs.of(lcbayes.read(table)), information=power)
        entry = registry.find(data["model"])
        options = entry.check(data["options"])
        self.problem, _ = build_problem(entry, options, self.epochs)
        self.dim = self.problem.dim

    def logdensity_fn(self, z):
        return -self.problem.potential(z, self.epochs)

    def constrain(self, z):
        sites = self.problem.constrain(z, self.epochs)
        return {name: sites[name] for name in self.problem.names}

    def unconstrain(self, sites):
        return self.problem.ravel({k: jax.numpy.asarray(v) for k, v in sites.items()})
'''


@dataclass(frozen=True)
class Exported:
    """A light curve, its model, and what makes the posterior hard."""

    title: str
    make: Callable[[], LightCurve]
    model: str
    options: Mapping[str, Any]
    keywords: tuple[str, ...]

    @property
    def model_name(self) -> str:
        return f"lcbayes_{self.model.replace('-', '_')}"


def _simulated(name: str | Path) -> Callable[[], LightCurve]:
    return lambda: simulate(scenario.load(name), NOISE_SEED)[0]


def _tumbler() -> LightCurve:
    import tumbling

    return tumbling.drawn(0)[0]


def _ariadne() -> LightCurve:
    path = DATA / "damit" / "43_Ariadne_rel.lcs"
    if not path.is_file():
        sys.exit(f"{path} is not there; set LCBAYES_DATA to the folder that holds damit/")
    return lcbayes.read(path)


POSTERIORS = {
    "ridge": Exported(
        "one facet, two passes: area and direction are correlated along a curved ridge",
        _simulated("one-facet"),
        "faceted",
        {"n_facets": 1, "spin": "none"},
        ("curved", "low-dimensional"),
    ),
    "mirror": Exported(
        "two facets and a spin, Sun and observer in one plane: two mirror images of equal weight",
        _simulated(HERE / "mirror.toml"),
        "faceted",
        {"n_facets": 2},
        ("multimodal", "label switching"),
    ),
    "glint": Exported(
        "three facets with a specular lobe: narrow modes and strong curvature",
        _simulated(HERE / "glint.toml"),
        "faceted-brdf",
        {"n_facets": 3, "spin": "none"},
        ("multimodal", "curved", "label switching"),
    ),
    "tumbler": Exported(
        "three facets on a tumbling body of unknown inertia: many narrow modes in the rates",
        _tumbler,
        "faceted",
        {"n_facets": 3, "spin": "torque-free", "omega_sd": 0.01},
        ("multimodal", "label switching", "differential equation"),
    ),
    "ariadne": Exported(
        "pole, period and convex shape of the asteroid 43 Ariadne",
        _ariadne,
        "convex-grid",
        {"period": 5.762},
        ("high-dimensional", "real data"),
    ),
}


def export(folder: Path, name: str, draws: int = DRAWS, **sampling: Any) -> None:
    """Write one posterior; ``sampling`` are options of `lcbayes.fit`."""
    one = POSTERIORS[name]
    curve = one.make()
    chains = {"num_chains": SAMPLED, "seed": 1} | sampling
    fit = lcbayes.fit(curve, model=one.model, progress=Console(), **one.options, **chains)
    # the power of the likelihood accounts for correlated noise
    power = float(fit.tree["log_likelihood"].attrs["information_per_point"])
    _write_data(folder, name, one, curve, power)
    _write_model(folder, one)
    entry = registry.find(one.model)
    problem, _ = build_problem(entry, entry.check(dict(one.options)), Epochs.of(curve))
    drawn = lcbayes.weighted_draws(fit.posterior, CHAINS * draws)
    sites = {site: drawn[site].values[0] for site in problem.names}
    reference = None
    if fit.trusted:
        reference = f"{name}-{one.model_name}"
        _write_draws(folder, reference, sites, draws)
        _write_json(_info(fit, reference, draws, chains), _reference(folder, "info", reference))
    posterior = {
        "name": f"{name}-{one.model_name}",
        "title": one.title,
        "keywords": list(one.keywords),
        "model_name": one.model_name,
        "data_name": name,
        "dimensions": {site: int(np.prod(v.shape[1:])) for site, v in sites.items()},
        "unconstrained_dimension": problem.dim,
        "reference_posterior_name": reference,
        "no_reference_because": [str(reason) for reason in fit.reasons],
        "urls": None,
        "references": None,
        **_added(),
    }
    _write_json(posterior, folder / "posteriors" / f"{posterior['name']}.json")


def _added() -> dict[str, str]:
    return {"added_by": "the lcbayes developers", "added_date": date.today().isoformat()}


def _write_data(folder: Path, name: str, one: Exported, curve: LightCurve, power: float) -> None:
    columns = {key: np.asarray(v).tolist() for key, v in columns_of(curve).items()}
    content = {
        "light_curve": columns,
        "meta": meta_of(curve),
        "model": one.model,
        "options": dict(one.options),
        "information": power,
    }
    _write_zip(content, folder / "data" / "data" / f"{name}.json.zip")
    info = {
        "name": name,
        "title": one.title,
        "description": "A light curve in the columns of a CSV file of lcbayes, with its model",
        "data_file": f"data/data/{name}.json",
        "keywords": list(one.keywords),
        **_added(),
    }
    _write_json(info, folder / "data" / "info" / f"{name}.info.json")


def _write_model(folder: Path, one: Exported) -> None:
    code = folder / "models" / "jax" / f"{one.model_name}.py"
    code.parent.mkdir(parents=True, exist_ok=True)
    code.write_text(DENSITY, encoding="utf-8")
    info = {
        "name": one.model_name,
        "title": f"Model {one.model!r} of lcbayes",
        "model_implementations": {
            "jax": {
                "model_code": f"models/jax/{one.model_name}.py",
                "lcbayes_version": installed_version(),
            }
        },
        **_added(),
    }
    _write_json(info, folder / "models" / "info" / f"{one.model_name}.info.json")


def _reference(folder: Path, kind: str, name: str) -> Path:
    ending = "info.json" if kind == "info" else "json.zip"
    return folder / "reference_posteriors" / "draws" / kind / f"{name}.{ending}"


def _write_draws(folder: Path, name: str, sites: dict[str, Any], draws: int) -> None:
    """A list of chains, each with the draws of every scalar by name, indices from 1."""
    flat: dict[str, np.ndarray] = {}
    for site, values in sites.items():
        for index in np.ndindex(values.shape[1:]):
            place = ",".join(str(i + 1) for i in index)
            flat[f"{site}[{place}]" if place else site] = values[(slice(None), *index)]
    chains = [
        {key: _rounded(v[k * draws : (k + 1) * draws]) for key, v in flat.items()}
        for k in range(CHAINS)
    ]
    _write_zip(chains, _reference(folder, "draws", name))


def _rounded(values: np.ndarray) -> list[float]:
    return [float(f"{x:.{DIGITS}g}") for x in values]


def _info(fit: Any, name: str, draws: int, sampling: dict[str, Any]) -> dict[str, Any]:
    table = fit.summary()
    worst = table.groupby("parameter", sort=False).agg(
        {"rhat": "max", "ess_bulk": "min", "ess_tail": "min"}
    )
    return {
        "name": name,
        "inference": {
            "method": "lcbayes.fit: NUTS in each solution, weighted by its evidence",
            "method_arguments": sampling,
        },
        "diagnostics": {
            "diagnostic_information": {"names": list(worst.index)},
            "ndraws": CHAINS * draws,
            "nchains": CHAINS,
            "effective_sample_size_bulk": worst["ess_bulk"].tolist(),
            "effective_sample_size_tail": worst["ess_tail"].tolist(),
            "r_hat": worst["rhat"].tolist(),
            "divergent_transitions": fit.content["divergences"],
        },
        "checks_made": {
            "ndraws_is_10k": CHAINS * draws == 10_000,
            "nchains_is_gte_4": True,
            "r_hat_below_1_01": bool((worst["rhat"] < 1.01).all()),
            "trusted_by_lcbayes": bool(fit.trusted),
        },
        "comments": "Draws of several solutions are mixed in random order, so that their R-hat is "
        "1; the diagnostics are the worst over the chains of each solution.",
        "versions": {"lcbayes": installed_version()},
        **_added(),
    }


def _write_zip(content: Any, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(path.name.removesuffix(".zip"), json.dumps(content))


def _write_json(content: Any, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def main(words: list[str]) -> None:
    if not words or not set(words[1:]) <= set(POSTERIORS):
        sys.exit(f"usage: export_posteriors.py DIR [{' | '.join(POSTERIORS)}]")
    for name in words[1:] or POSTERIORS:
        export(Path(words[0]), name)
        print(f"{name}: written to {words[0]}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
