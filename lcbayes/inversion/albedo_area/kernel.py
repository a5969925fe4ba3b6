"""Flux of a unit albedo-area towards the observer: one column per normal and material."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.inversion.albedo_area.observed import Observed
from lcbayes.physics.reflectance import LAWS, geometry

Floats = NDArray[np.float64]

UNIT = ("r_diff", "r_spec", "w")  # reflectances: one is set to 1, and the areas absorb its value
_PAD = 128  # normals are padded to multiples of this, to limit the number of compiled sizes


@dataclass(frozen=True)
class Material:
    """A reflecting component: a law and its parameters, except for one free reflectance.

    Attributes
    ----------
    law : str
        One of `reflectance.LAWS`.
    reflectance : "r_diff", "r_spec" or "w"
        The reflectance set to 1; areas of a solution are that reflectance times area, m². The other
        reflectances are 0.
    parameters : mapping
        Parameters of the law; those with a default may be omitted.
    """

    law: str = "lambertian"
    reflectance: str = "r_diff"
    parameters: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def parse(cls, text: str) -> Material:
        """Material from ``LAW`` or ``LAW:NAME=VALUE,NAME=VALUE``, the command-line form.

        A law with only a diffuse part is diffuse. A law with both a diffuse and a specular part
        represents the specular part, which is the purpose of a second column.

        Raises
        ------
        InputError
            If the law or a parameter is unknown, missing, or out of range.
        """
        name, _, rest = text.partition(":")
        name = name.strip()
        if name not in LAWS:
            raise InputError(f"unknown law {name!r}; available: {', '.join(LAWS)}")
        known = LAWS[name].parameters
        given = {}
        for pair in filter(None, (p.strip() for p in rest.split(","))):
            key, equals, value = pair.partition("=")
            try:
                given[key.strip()] = float(value)
            except ValueError:
                equals = ""
            if not equals:
                raise InputError(f"material {text!r}: {pair!r} is not NAME=NUMBER")
        open_ = next(u for u in ("r_spec", "r_diff", "w") if u in known)
        closed = [u for u in UNIT if u in given]
        if closed:
            raise InputError(
                f"material {text!r}: {closed[0]} is what is solved for, together with the area; "
                "leave it out"
            )
        for key, value in given.items():
            if key not in known or key == "nv":
                options = [k for k in known if k not in (*UNIT, "nv")]
                raise InputError(
                    f"material {text!r}: unknown parameter {key!r}; {name} has "
                    f"{', '.join(options) or 'none'}"
                )
            lower, upper, meaning, _ = known[key]
            if not lower <= value <= upper:
                raise InputError(
                    f"material {text!r}: {key} ({meaning}) lies in {lower:g}..{upper:g}"
                )
        parameters = {}
        for key, parameter in known.items():
            if key == "nv" or key in UNIT:
                continue
            value = given.get(key, parameter.default)
            if value is None:
                raise InputError(f"material {text!r}: give {key} ({parameter.meaning})")
            parameters[key] = float(value)
        return cls(name, open_, parameters)

    @property
    def unit(self) -> dict[str, float]:
        """All parameters of the law, with the free reflectance set to 1."""
        known = LAWS[self.law].parameters
        fixed = {u: float(u == self.reflectance) for u in UNIT if u in known}
        return fixed | dict(self.parameters)

    @property
    def specular(self) -> bool:
        return self.reflectance == "r_spec"

    def __str__(self) -> str:
        values = ", ".join(f"{k} = {v:g}" for k, v in self.parameters.items())
        return f"{self.law} ({values})" if values else self.law


LAMBERTIAN = Material()


def columns(
    seen: Observed,
    normals: Floats,
    which: NDArray[np.integer],
    materials: Sequence[Material] = (LAMBERTIAN,),
) -> Floats:
    """K (T, n): flux of facets of unit albedo-area, f_r μ₀ μ where lit and seen, else 0.

    The flux of a body is f = K α with α (n,) ≥ 0: Hall's L_i = Σ_j aA_j K_ij, with j the master
    index of directions and materials. It is averaged over the exposure of each point.

    Parameters
    ----------
    seen : Observed
    normals : (n, 3)
        Outward unit normals, body frame.
    which : (n,) int
        Material index of each normal.
    materials : sequence of Material

    References
    ----------
    Hall et al. 2007, eqs. (5)-(14); F_sun is omitted (unit irradiance).
    """
    out = np.empty((len(seen.flux), len(normals)))
    for m, material in enumerate(materials):
        here = which == m
        out[:, here] = _padded(_kernel, seen, normals[here], material)
    return out


def slopes(
    seen: Observed,
    normals: Floats,
    which: NDArray[np.integer],
    materials: Sequence[Material] = (LAMBERTIAN,),
) -> tuple[Floats, Floats]:
    """K (T, n) and its derivatives with respect to the components of each normal, (T, n, 3)."""
    value = np.empty((len(seen.flux), len(normals)))
    slope = np.empty((*value.shape, 3))
    for m, material in enumerate(materials):
        here = which == m
        value[:, here], slope[:, here] = _padded(_kernel_slopes, seen, normals[here], material)
    return value, slope


def _padded(function, seen: Observed, normals: Floats, material: Material):
    n = len(normals)
    full = np.tile([0.0, 0.0, 1.0], (-(-max(n, 1) // _PAD) * _PAD, 1))
    full[:n] = normals
    values = function(material.law, material.unit, seen.sun, seen.obs, seen.weight, full)
    return jax.tree.map(lambda x: np.asarray(x)[:, :n], values)


@partial(jax.jit, static_argnums=0)
def _kernel(law, parameters, sun, obs, weight, normals):
    def instant(sun, obs):
        angles, lit = geometry(sun, obs, normals)
        return jnp.where(lit, LAWS[law].brdf(angles, parameters) * angles.mu0 * angles.mu, 0.0)

    return jnp.tensordot(weight, jax.vmap(instant)(sun, obs), axes=1)


@partial(jax.jit, static_argnums=0)
def _kernel_slopes(law, parameters, sun, obs, weight, normals):
    def at(normals):
        return _kernel(law, parameters, sun, obs, weight, normals)

    # a column depends only on its own normal: three tangents give all derivatives
    value = at(normals)
    by = [jax.jvp(at, (normals,), (jnp.broadcast_to(e, normals.shape),))[1] for e in jnp.eye(3)]
    return value, jnp.stack(by, axis=-1)
