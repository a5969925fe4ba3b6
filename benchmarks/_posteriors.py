"""The posteriors of samplers.py: densities with an information matrix, whitened at the mode."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.data.read import read
from lcbayes.geometry.spherical import unit_vector
from lcbayes.inference import correlation, search
from lcbayes.modelling import registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.modelling.recorded import Sites
from lcbayes.samplers.chains import Whitening
from lcbayes.simulation.scenarios import scenario
from lcbayes.simulation.simulate import simulate

HERE = Path(__file__).parent
DATA = Path(os.environ.get("LCBAYES_DATA", HERE.parents[1] / "shared" / "data"))
WIDEN = 2.0  # sd of the starting points about the mode, in posterior widths
NOISE_SEED = 1


@dataclass(frozen=True, eq=False)
class Posterior:
    """exp(−U) over z = centre + factor y; the samplers see y.

    Attributes
    ----------
    potential_z, fisher_z : (z (D,), data) → U, and information plus prior precision (D, D)
    data : argument of both, so that it is not compiled into a program
    """

    potential_z: Callable[[jax.Array, Any], jax.Array]
    fisher_z: Callable[[jax.Array, Any], jax.Array]
    data: Any
    whitening: Whitening

    @property
    def dim(self) -> int:
        return self.whitening.centre.size

    @property
    def args(self) -> tuple[Whitening, Any]:
        return self.whitening, self.data

    def potential(self, y: jax.Array, whitening: Whitening, data: Any) -> jax.Array:
        return self.potential_z(whitening(y), data)

    def fisher(self, y: jax.Array, whitening: Whitening, data: Any) -> jax.Array:
        return whitening.factor.T @ self.fisher_z(whitening(y), data) @ whitening.factor

    def starts(self, n: int, seed: int) -> jax.Array:
        """n draws (n, D) of finite density from the widened Gaussian at the mode."""
        y = WIDEN * np.random.default_rng(seed).standard_normal((8 * n, self.dim))
        return jnp.asarray(y[np.isfinite(_potentials(self, jnp.asarray(y), self.args))][:n])

    def z(self, y: Any) -> np.ndarray:
        """The model's own unconstrained coordinates of draws y (..., D)."""
        return np.asarray(self.whitening.centre) + y @ np.asarray(self.whitening.factor).T


@partial(jax.jit, static_argnums=0)
def _potentials(post: Posterior, y: jax.Array, args: tuple[Whitening, Any]) -> jax.Array:
    return jax.lax.map(lambda row: post.potential(row, *args), y)


def banana() -> Posterior:
    """x ~ N(0, 1), y ~ N(0.4 (x² − 1), 0.6²), as in the invariance tests."""

    def residuals(z: jax.Array) -> jax.Array:
        return jnp.stack([z[0], (z[1] - 0.4 * (z[0] ** 2 - 1.0)) / 0.6])

    def potential(z: jax.Array, data: None) -> jax.Array:  # noqa: ARG001
        return 0.5 * jnp.sum(residuals(z) ** 2)

    def fisher(z: jax.Array, data: None) -> jax.Array:  # noqa: ARG001
        jacobian = jax.jacfwd(residuals)(z)
        return jacobian.T @ jacobian

    mode = jnp.array([0.0, -0.4])
    factor = jnp.linalg.inv(jax.jacfwd(residuals)(mode))
    return Posterior(potential, fisher, None, Whitening(mode, factor))


def one_facet() -> Posterior:
    what = scenario.load("one-facet")
    return _simulated(what, "faceted", {"n_facets": 1, "spin": "none"})


def two_facets() -> Posterior:
    what = scenario.load("two-facet-spin")
    return _simulated(what, "faceted", {"n_facets": 2})


def glint() -> Posterior:
    what = scenario.load(HERE / "glint.toml")
    return _simulated(what, "faceted-brdf", {"n_facets": 3, "spin": "none"})


def _simulated(what: scenario.Scenario, model: str, options: dict[str, Any]) -> Posterior:
    """The posterior of a simulated curve, at the solution closest to the truth."""
    curve, truth = simulate(what, NOISE_SEED)
    data = Epochs.of(curve)
    problem = Problem(registry.find(model).bind(options), data)
    surfaces = [what.materials[label].parameters for label in what.body.labels]
    p = {k: jnp.array([s[k] for s in surfaces]) for k in surfaces[0]}
    shares = p["r_diff"] + p.get("r_spec", 0.0)
    sites: Sites = {
        "normals_base": jnp.array([f["normal"] for f in truth["facets"]]),
        "log_albedo_area": jnp.log(jnp.asarray(what.body.areas) * shares),
        "omega_unit": jnp.array(truth["attitude"].get("omega_rad_s", [0.0])) / 0.1,
        "r_sum": shares,
        "specular_share": p.get("r_spec", 0.0) / shares,
        **{f"log_{k}": jnp.log(p[k]) for k in ("nu",) if k in p},
    }
    return _at(problem, _climb(problem, problem.ravel(sites), data), data)


def ariadne() -> Posterior:
    """43 Ariadne by `convex-grid` at the published pole and period, as in `lcbayes.fit`."""
    path = DATA / "damit" / "43_Ariadne_rel.lcs"
    if not path.is_file():
        sys.exit(f"{path} is not there; set LCBAYES_DATA to the folder that holds damit/")
    entry, options = registry.find("convex-grid"), {"period": 5.762}
    starts, coordinates = entry.hook("starts"), entry.hook("coordinates")
    assert starts is not None
    assert coordinates is not None
    data = Epochs.of(read(path))
    model = entry.bind(options)
    plain = Problem(model, data)
    lon, lat = np.deg2rad([253.2, -17.2])
    pole = unit_vector(lon, lat)
    sites = starts(data, jax.random.key(0), **options)[0]
    period_sd = (5.762 * 3600.0) ** 2 / (2.0 * data.t_span)  # s, of its prior
    sites |= {
        "pole_base": jnp.asarray(pole)[None],
        "period_shift": (5.761980 - 5.762) * 3600.0 / period_sd,
    }
    z = _climb(plain, plain.ravel(sites), data)
    data = correlation.tempered(plain, np.asarray(z), data)
    z = _climb(plain, z, data)
    problem = Problem(model, data, coordinates(data, **options))
    return _at(problem, problem.ravel(plain.constrain(z, data)), data)


def _climb(problem: Problem, z: jax.Array, data: Epochs) -> jax.Array:
    """The mode reached by Fisher scoring from z."""
    return jnp.asarray(search.advance(problem, data, search.init(z[None]), 300).z[0])


def _at(problem: Problem, z: jax.Array, data: Epochs) -> Posterior:
    whitening = Whitening.at(problem, np.asarray(z), data)
    return Posterior(problem.potential, problem.fisher, data, whitening)


# name on the command line: title, and function that makes it
POSTERIORS: dict[str, tuple[str, Callable[[], Posterior]]] = {
    "one-facet": ("one facet, two passes", one_facet),
    "two-facets": ("two facets and ω", two_facets),
    "glint": ("three-facet Ashikhmin-Shirley glint", glint),
    "ariadne": ("convex-grid on 43 Ariadne", ariadne),
    "banana": ("the banana", banana),
}
