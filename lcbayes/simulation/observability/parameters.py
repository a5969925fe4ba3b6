"""Unknown parameters of a scenario, with names and prior widths.

Each parameter is a change of a value of the scenario and is zero at that value. Areas, exponents,
slopes and periods are represented by logarithms, and directions by rotations in rad, so that unit
changes are comparable.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.physics.attitude import rotations
from lcbayes.physics.attitude.laws import ConstantRate, Ephemeris, PrincipalAxis, TorqueFree
from lcbayes.physics.reflectance import LAWS
from lcbayes.simulation.scenarios.scenario import Scenario
from lcbayes.simulation.simulate import predicted_flux

Floats = NDArray[np.float64]

GROUPS = ("attitude", "spin", "normals", "areas", "surface")
USUAL = ("spin", "normals", "areas", "surface")  # what `lcbayes fit` infers
SLOW = 1e-3  # rad/s, prior width of the spin if the scenario has no rotation
DIRECTION_SD = 3.0**-0.5  # sd of a uniform direction along one transverse axis, as in priors.py
_LOGARITHMIC = ("nu", "nv", "n", "m", "d")  # positive surface parameters that range over decades


@dataclass(frozen=True)
class Parameter:
    """One unknown.

    Attributes
    ----------
    name : as in output files
    group : one of `GROUPS`
    unit : unit of the parameter; "1" for a logarithm or a reflectance
    words : description for output
    prior_sd : prior standard deviation, in that unit
    facet : index of its facet (from 0), or None
    """

    name: str
    group: str
    unit: str
    words: str
    prior_sd: float
    facet: int | None = None


@dataclass(frozen=True)
class Unknowns:
    """The unknown parameters θ of a scenario, and the flux as a function of θ.

    Attributes
    ----------
    scenario : the truth, at θ = 0
    parameters : in the order of θ
    """

    scenario: Scenario
    parameters: tuple[Parameter, ...]

    @classmethod
    def of(cls, scenario: Scenario, groups: Sequence[str] = USUAL) -> Unknowns:
        """The unknowns of the named groups.

        With both "attitude" and "normals", the body axes are arbitrary, so that three combinations
        are unobservable for any measurements.

        Raises
        ------
        InputError
            If a group is not one of `GROUPS`, or if there are no unknowns.
        """
        for group in groups:
            if group not in GROUPS:
                raise InputError(
                    f"unknown group of parameters {group!r}; available: {', '.join(GROUPS)}"
                )
        parameters = [p for p in _all(scenario) if p.group in groups]
        if not parameters:
            raise InputError(
                f"scenario {scenario.name!r} has nothing unknown in {', '.join(groups)}; "
                f"name other groups: {', '.join(GROUPS)}"
            )
        return cls(scenario, tuple(parameters))

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(p.name for p in self.parameters)

    @property
    def prior_sd(self) -> Floats:
        return np.array([p.prior_sd for p in self.parameters])

    def rows(self, *groups: str) -> NDArray[np.intp]:
        """Indices in θ of the parameters of these groups."""
        return np.flatnonzero([p.group in groups for p in self.parameters])

    def flux(self, theta: jax.Array, t: jax.Array, sun: jax.Array, obs: jax.Array) -> jax.Array:
        """Flux at unit distance under unit irradiance for θ (P,), m², (T,)."""
        value = dict(zip(self.names, theta, strict=True))
        changed = self._body(self._spin(self._surface(self.scenario, value), value), value)
        error = None
        if "attitude_x" in value:
            error = jnp.stack([value[f"attitude_{axis}"] for axis in "xyz"])
        if "pole_east" in value:  # a tilt of the body is the inverse tilt of Sun and observer
            back = self._tilt(value["pole_east"], value["pole_north"])
            sun, obs = sun @ back, obs @ back
        return predicted_flux(changed, Ephemeris(t, sun), obs, error)

    def _tilt(self, east: jax.Array, north: jax.Array) -> jax.Array:
        """Inertial rotation (3, 3) about an axis perpendicular to the pole, by angles in rad.

        East and north are the directions of increasing longitude and latitude of the pole, also at
        ±90°. The rotation has no component about the pole, so that all poles are treated alike.
        """
        law = self.scenario.attitude
        assert isinstance(law, PrincipalAxis)
        law = replace(law, phase0_deg=0.0)
        axes = law.frames(Ephemeris(jnp.zeros(1), jnp.zeros((1, 3)))).body[0]
        # a tilt towards d has the axis pole × d; pole × east = north
        south, eastward = axes[:, 0], axes[:, 1]
        return rotations.constant_rate(jnp.ones(1), -east * south - north * eastward)[0]

    def _spin(self, scenario: Scenario, value: dict[str, jax.Array]) -> Scenario:
        law = scenario.attitude
        if "omega_x" in value and isinstance(law, ConstantRate):
            change = jnp.stack([value[f"omega_{axis}"] for axis in "xyz"])
            omega = jnp.asarray(law.omega_rad_s) + change
            return replace(scenario, attitude=ConstantRate(omega))  # pyright: ignore[reportArgumentType]
        if "log_period" in value and isinstance(law, PrincipalAxis):
            period = law.period_s * jnp.exp(value["log_period"])
            return replace(scenario, attitude=replace(law, period_s=period))
        return scenario

    def _surface(self, scenario: Scenario, value: dict[str, jax.Array]) -> Scenario:
        materials = {}
        for name, material in scenario.materials.items():
            given = dict(material.parameters)
            for key, was in given.items():
                if f"{name}.{key}" in value:
                    given[key] = was + value[f"{name}.{key}"]  # pyright: ignore[reportArgumentType]
                elif f"{name}.log_{key}" in value:
                    given[key] = was * jnp.exp(value[f"{name}.log_{key}"])  # pyright: ignore[reportArgumentType]
            was = material.parameters.get("nu")
            if (
                was is not None
                and given["nu"] is not was
                and not any(f"{name}.{k}nv" in value for k in ("", "log_"))
            ):
                given["nv"] = given["nu"]  # isotropic
            materials[name] = replace(material, parameters=given)
        return replace(scenario, materials=materials)

    def _body(self, scenario: Scenario, value: dict[str, jax.Array]) -> Scenario:
        body = scenario.body
        normals, axes, areas = (jnp.asarray(x) for x in (body.normals, body.u_axes, body.areas))
        n = len(body.areas)
        tilt = [[value.get(f"normal_{i}_{k}", 0.0) for k in "uvn"] for i in range(n)]
        if any(p.group == "normals" for p in self.parameters):
            u, v, w = jnp.asarray(tilt).T[:, :, None]
            # a tilt towards u has the axis n × u = v, one towards v the axis n × v = −u
            about = u * jnp.cross(normals, axes) - v * axes + w * normals
            turn = jax.vmap(lambda a: rotations.constant_rate(jnp.ones(1), a)[0])(about)
            normals, axes = (jnp.einsum("nij,nj->ni", turn, x) for x in (normals, axes))
        if any(p.group == "areas" for p in self.parameters):
            log = [
                value.get(f"log_area_{i}", value.get(f"log_albedo_area_{i}", 0.0)) for i in range(n)
            ]
            areas = areas * jnp.exp(jnp.asarray(log))
        return replace(
            scenario,
            body=body._replace(normals=normals, u_axes=axes, areas=areas),
        )


def _all(scenario: Scenario) -> list[Parameter]:
    parameters = [
        Parameter(f"attitude_{a}", "attitude", "rad", f"attitude about body {a}", DIRECTION_SD)
        for a in "xyz"
    ]
    if isinstance(scenario.attitude, ConstantRate):
        # prior: rate known to an order of magnitude, direction unknown; wider is not linear
        rate = float(np.linalg.norm(scenario.attitude.omega_rad_s))
        wide = DIRECTION_SD * rate if rate > 0.0 else SLOW
        parameters += [Parameter(f"omega_{a}", "spin", "rad/s", f"ω_{a}", wide) for a in "xyz"]
    elif isinstance(scenario.attitude, TorqueFree):
        raise InputError(
            f"scenario {scenario.name!r}: observability does not count the unknowns of a "
            "torque-free body (its rates and inertia) and would promise too much; choose law = "
            "'constant-rate' or 'principal-axis', or simulate and fit"
        )
    elif isinstance(scenario.attitude, PrincipalAxis):
        parameters += [
            Parameter("pole_east", "spin", "rad", "eastward tilt of the pole", DIRECTION_SD),
            Parameter("pole_north", "spin", "rad", "northward tilt of the pole", DIRECTION_SD),
            Parameter("log_period", "spin", "1", "period", 1.0),
        ]
    body = scenario.body
    anisotropic = []
    for i, label in enumerate(body.labels):
        material = scenario.materials[label]
        p = material.parameters
        anisotropic.append("nv" in p and p["nv"] != p["nu"])
        axes = "uvn" if anisotropic[-1] else "uv"
        parameters += [
            Parameter(f"normal_{i}_{k}", "normals", "rad", _tilt_words(i, k), DIRECTION_SD, i)
            for k in axes
        ]
    for i, label in enumerate(body.labels):
        diffuse = LAWS[scenario.materials[label].law].diffuse
        name, word = ("log_albedo_area", "albedo-area") if diffuse else ("log_area", "area")
        parameters.append(Parameter(f"{name}_{i}", "areas", "1", f"{word} of facet {i}", 1.0, i))
    for name in dict.fromkeys(body.labels):
        parameters += _surface(name, scenario)
    return parameters


def _tilt_words(facet: int, axis: str) -> str:
    if axis == "n":
        return f"turn of facet {facet} about its normal"
    return f"tilt of facet {facet} towards its {axis} axis"


def _surface(name: str, scenario: Scenario) -> list[Parameter]:
    """Parameters of one material; albedo-areas include the reflectance of a diffuse law."""
    material = scenario.materials[name]
    law = LAWS[material.law]
    parameters = []
    for key, allowed in law.parameters.items():
        isotropic = key == "nv" and material.parameters["nv"] == material.parameters["nu"]
        if isotropic or (law.diffuse and key in ("r_diff", "w")):
            continue
        value = material.parameters[key]
        if key in _LOGARITHMIC and value > 0.0:
            parameters.append(
                Parameter(f"{name}.log_{key}", "surface", "1", f"{key} of {name}", 1.0)
            )
        else:
            wide = (allowed.upper - allowed.lower) / np.sqrt(12.0)
            words = f"{key} of {name}"
            parameters.append(Parameter(f"{name}.{key}", "surface", "1", words, float(wide)))
    return parameters
