"""Six light curves whose posteriors are known: the problems of `posteriors.json`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from numpyro import handlers

from lcbayes.core.constants import EARTH_RADIUS_KM
from lcbayes.core.jax_setup import jnp
from lcbayes.data.lightcurve import LightCurve
from lcbayes.modelling import registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.registry import Entry
from lcbayes.physics import brightness
from lcbayes.results.draws import weighted_draws
from lcbayes.simulation.simulate import simulate
from lcbayes.tasks.fit.run import Fit
from tests.helpers import one_facet_posterior, small_curves

Floats = NDArray[np.float64]
Sites = Mapping[str, Floats]

HERE = Path(__file__).parent
TWO_PANELS = {"law": "yaw-steering", "facets": "+z, +x", "reflectance": "lambertian"}


@dataclass(frozen=True)
class Reference:
    """A light curve, a model, and the quantities whose posterior moments are known.

    Attributes
    ----------
    make : () → the light curve, from fixed seeds
    quantities : sites of n draws, (n, …) each → name: (n,). None of them changes where facets
        that are alike change places.
    shape : of its posterior, in words
    """

    name: str
    shape: str
    make: Callable[[], LightCurve]
    quantities: Callable[[Sites], dict[str, Floats]]
    model: str = "faceted"
    options: dict[str, Any] = field(default_factory=dict)

    @cached_property
    def curve(self) -> LightCurve:
        return self.make()

    @cached_property
    def data(self) -> Epochs:
        return Epochs.of(self.curve)

    @cached_property
    def entry(self) -> Entry:
        return registry.find(self.model)

    def draws(self, result: Fit) -> tuple[tuple[str, ...], Floats, Sites]:
        """Names, the quantities (C, S, Q) of a fit's draws, and its sites (C S, …)."""
        drawn = weighted_draws(result.tree, seed=result.content["seed"])["posterior"]
        sites = {str(k): np.asarray(v)[0] for k, v in drawn.data_vars.items()}
        values = self.quantities(sites)
        chains = int(np.unique(result.posterior["solution"], return_counts=True)[1].max())
        shape = (chains, drawn.sizes["draw"] // chains)
        return tuple(values), np.stack([v.reshape(shape) for v in values.values()], -1), sites

    def bound(self) -> Callable[[Epochs], Any]:
        """The NumPyro model."""
        return self.entry.bind(self.entry.check(self.options))


def scalars(*names: str) -> Callable[[Sites], dict[str, Floats]]:
    """Sites of one number, or of one facet."""
    return lambda sites: {k: np.reshape(sites[k], len(sites[k])) for k in names}


def _spin(sites: Sites) -> dict[str, Floats]:
    return {f"omega_{axis}": sites["omega"][:, i] for i, axis in enumerate("xyz")}


def _turning(sites: Sites) -> dict[str, Floats]:
    return scalars("log_albedo_area", "phi", "g")(sites) | _spin(sites)


def _two_turning(sites: Sites) -> dict[str, Floats]:
    """The larger and the smaller facet, their mean direction, the cosine between them, the spin."""
    area, normals = np.sort(sites["albedo_area"], axis=1), sites["normals"]
    both = np.sum(sites["albedo_area"][..., None] * normals, axis=1)
    return {
        "largest_area": area[:, -1],
        "smallest_area": area[:, 0],
        "total_z": both[:, 2],
        "cosine_between": np.sum(normals[:, 0] * normals[:, 1], axis=-1),
    } | _spin(sites)


def _lobe(sites: Sites) -> dict[str, Floats]:
    return scalars("log_albedo_area", "phi", "g", "specular_share", "log_n", "r_sum")(sites)


def _stabilised(sites: Sites) -> dict[str, Floats]:
    area = sites["log_albedo_area_held"]
    return {"log_area_z": area[:, 0], "log_area_x": area[:, 1], "log_sigma": sites["log_sigma"]}


def _two_passes() -> LightCurve:
    """As in secs. VII.A and B of the paper, 11 points each, noise a quarter of the peak."""
    truth = one_facet_posterior.Truth(g=0.15)
    return simulate(one_facet_posterior.experiment(2, truth=truth, sigma=0.7, step=10.0), 1)[0]


def _glossy() -> LightCurve:
    """One facet with a broad Blinn-Phong lobe, 60 points, errors of 5 % of the mean."""
    sun, obs = small_curves.directions(60, seed=4)
    surface = {"r_diff": 0.3, "r_spec": 0.4, "n": 12.0}
    facet = jnp.asarray(small_curves.NORMALS[:1]), jnp.asarray(small_curves.AREAS[:1] / 0.7)
    flux = np.asarray(
        brightness.flux_brdf(
            jnp.asarray(sun),
            jnp.asarray(obs),
            *facet,
            "blinn-phong",
            {k: jnp.array([v]) for k, v in surface.items()},
        )
    )
    error = np.full(60, 0.05 * flux.mean())
    noisy = flux + error * np.random.default_rng(5).standard_normal(60)
    return small_curves.curve(60, sun=sun, obs=obs, brightness=noisy, error=error)


def _dusk() -> LightCurve:
    """A satellite 550 km above places at dusk, V magnitudes of two facets, scatter 0.2 mag."""
    rng = np.random.default_rng(6)
    n = 30
    unit = lambda v: v / np.linalg.norm(v, axis=-1, keepdims=True)  # noqa: E731
    site = unit(np.array([0.1, 0.95, 0.3]) + 0.1 * rng.standard_normal((n, 3)))
    up = unit(site + 0.06 * rng.standard_normal((n, 3)))
    position = (EARTH_RADIUS_KM + 550.0) * up
    line = EARTH_RADIUS_KM * site - position
    light = LightCurve(
        t=np.linspace(0.0, 300.0, n),
        brightness=np.full(n, 6.0),
        error=None,
        kind="mag",
        sun=np.tile(unit(np.array([1.0, -0.45, 0.0])), (n, 1)),
        obs=unit(line),
        range_km=np.linalg.norm(line, axis=1),
        position_km=position,
        velocity_km_s=7.6 * unit(np.cross(up, [0.3, 0.2, 1.0])),
        band=np.full(n, "V"),
        frame="icrs",
    )
    truth = {"log_albedo_area_held": jnp.log(jnp.array([3.0, 8.0])), "log_sigma": jnp.log(0.2)}
    model = handlers.seed(registry.find("stabilised").bind(TWO_PANELS), 0)
    trace = handlers.trace(handlers.substitute(model, truth)).get_trace(Epochs.of(light))
    noisy = np.asarray(trace["expected"]["value"]) + 0.2 * rng.standard_t(4, n)
    return replace(light, brightness=noisy)


def _flat() -> LightCurve:
    """Flux 0.5 ± 1.4 in three points: of y + x²."""
    return small_curves.curve(3, brightness=np.array([0.9, -0.6, 1.2]), error=np.full(3, 2.5))


ALL = (
    Reference(
        "one-facet",
        "three dimensions, skewed and bent",
        _two_passes,
        scalars("log_albedo_area", "phi", "g"),
        options={"n_facets": 1, "spin": "none"},
    ),
    Reference(
        "turning-facet",
        "a facet and its spin, correlated",
        lambda: small_curves.curve(30, spinning=True, noise=0.15),
        _turning,
        options={"n_facets": 1, "omega_sd": 0.02},
    ),
    Reference(
        "two-turning-facets",
        "eleven dimensions, one solution, facets alike",
        lambda: small_curves.curve(80, 2, spinning=True, noise=0.05),
        _two_turning,
        options={"n_facets": 2, "omega_sd": 0.02},
    ),
    Reference(
        "glossy-facet",
        "bounded shares: what the data do not fix is the prior's",
        _glossy,
        _lobe,
        "faceted-brdf",
        {"n_facets": 1, "spin": "none", "law": "blinn-phong"},
    ),
    Reference(
        "stabilised",
        "magnitudes, Student-t residuals, a scatter to be found",
        _dusk,
        _stabilised,
        "stabilised",
        TWO_PANELS,
    ),
    Reference(
        "banana",
        "a bent ridge, of a user's own model",
        _flat,
        scalars("x", "y"),
        str(HERE / "banana.py"),
    ),
)
BY_NAME = {one.name: one for one in ALL}
