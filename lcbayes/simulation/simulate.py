"""Light curves from scenarios: geometry, brightness, noise, and the truth that goes with them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.constants import HOUR_S
from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.data import earth_shadow
from lcbayes.data.lightcurve import LightCurve
from lcbayes.modelling.ephemeris import ephemeris
from lcbayes.physics import brightness, photometry
from lcbayes.physics.attitude import rotations
from lcbayes.physics.attitude.laws import (
    Attitude,
    ConstantRate,
    Ephemeris,
    PrincipalAxis,
    TorqueFree,
)
from lcbayes.physics.bodies import facets
from lcbayes.physics.bodies.shapes import Body
from lcbayes.physics.reflectance import LAWS
from lcbayes.physics.sensitivity import MAGNITUDE_PER_NEPER
from lcbayes.simulation.scenarios import parts
from lcbayes.simulation.scenarios.body import Material
from lcbayes.simulation.scenarios.epochs import epochs
from lcbayes.simulation.scenarios.scenario import Scenario

Floats = NDArray[np.float64]

CHUNK = 1_000_000  # facet-epochs at a time: memory does not grow with the length of a curve


def simulate(scenario: Scenario, seed: int = 0) -> tuple[LightCurve, dict[str, Any]]:
    """A noisy light curve of a scenario, and the truth behind it.

    Parameters
    ----------
    scenario : Scenario
    seed : int
        Of the noise; the same scenario and seed give the same numbers.

    Returns
    -------
    LightCurve
        Flux (with ranges W/m², else at unit distance) or magnitudes, dimmed in the Earth's
        penumbra where the scenario has an orbit. Epochs at which nothing of the body is lit and
        seen have no magnitude and are left out where one is needed.
    dict
        The truth, ready for JSON: see `truth`.

    Raises
    ------
    InputError
        The geometry has no usable epoch, or no distances where magnitudes are asked for, or the
        body is dark at all epochs.
    """
    curve = epochs(scenario.geometry)
    if scenario.kind == "mag" and curve.range_km is None:
        raise InputError(
            f"scenario {scenario.name!r}: its geometry has no range_km, and a magnitude needs a "
            "distance; add that column, or set output.kind = 'flux'"
        )
    flux = flux_at(scenario, curve.t, curve.sun, curve.obs, ephemeris(curve))
    flux = flux * earth_shadow.share(curve)
    if scenario.kind == "mag" or scenario.noise.kind == "mag_err":
        kept = flux > 0.0
        if not kept.any():
            raise InputError(
                f"scenario {scenario.name!r}: no facet is lit and seen at any of {len(flux)} "
                "epochs, so there is no magnitude; change the body, its attitude or the geometry"
            )
        n_dark, curve, flux = int(np.sum(~kept)), curve.select(kept), flux[kept]
    else:
        n_dark = 0
    clean = _in_units(scenario, curve, flux)
    sigma = _noise_sd(scenario, clean)
    noisy = clean + sigma * np.random.default_rng(seed).standard_normal(clean.size)
    n = curve.n_obs
    curve = replace(
        curve,
        brightness=noisy,
        error=sigma,
        kind=scenario.kind,
        band=np.full(n, scenario.band),
        exposure_s=np.full(n, scenario.exposure_s),
        source={"file": scenario.name, "format": "simulated", "seed": str(seed)},
    )
    return curve, truth(scenario, seed, curve, clean, n_dark)


def flux_at(
    scenario: Scenario, t: Floats, sun: Floats, obs: Floats, orbit: Ephemeris | None = None
) -> Floats:
    """Noise-free flux at unit distance under unit irradiance, averaged over the exposure, m².

    Parameters
    ----------
    t : (T,) s
        Time since the instant at which the attitude law starts.
    sun, obs : (T, 3)
        Unit vectors to Sun and observer, inertial; constant during an exposure.
    orbit : Ephemeris, optional
        At the same times, for laws that ask for more than time and Sun; constant during an
        exposure but for the time.
    """
    along = Ephemeris(jnp.asarray(t), jnp.asarray(sun)) if orbit is None else orbit
    part = jax.jit(partial(predicted_flux, scenario))
    size = max(1, CHUNK // len(scenario.body.areas))
    blocks = [slice(i, i + size) for i in range(0, len(t), size)]
    return np.concatenate([part(along.at(rows), jnp.asarray(obs[rows])) for rows in blocks])


def predicted_flux(
    scenario: Scenario,
    along: Ephemeris,
    obs: jax.Array,
    attitude_error: jax.Array | None = None,
) -> jax.Array:
    """What `flux_at` gives, in one piece and differentiable: the numbers of the scenario may be
    traced arrays.

    Parameters
    ----------
    attitude_error : (3,) rad, optional
        Hinks' δα, constant in the body frame: the body's true components of a vector are
        exp([δα×]) times those of the scenario's attitude. An articulated array is not turned.
    """
    moving = np.array(scenario.on_array or [False] * len(scenario.body.areas))

    def at(instants: jax.Array) -> jax.Array:
        made = scenario.attitude.frames(along._replace(t=instants))
        total = jnp.zeros(instants.shape)
        for rotation, which in ((made.body, ~moving), (made.array, moving)):
            if rotation is None or not which.any():
                continue
            to_sun, to_obs = (rotations.to_body(rotation, v) for v in (along.sun, obs))
            if attitude_error is not None and rotation is made.body:
                turn = rotations.constant_rate(jnp.ones(1), attitude_error)[0]
                to_sun, to_obs = to_sun @ turn.T, to_obs @ turn.T
            visible = (
                None if scenario.parts is None else scenario.parts.lit_and_seen(to_sun, to_obs)
            )
            total += body_flux(scenario.body, scenario.materials, to_sun, to_obs, which, visible)
        return total

    t, exposure = along.t, scenario.exposure_s
    return photometry.exposed(at, jnp.full(t.shape, exposure))(t) if exposure else at(t)


def in_body(scenario: Scenario, along: Ephemeris, *vectors: jax.Array) -> tuple[jax.Array, ...]:
    """Body-frame components of inertial vectors (T, 3), each."""
    rotation = scenario.attitude.frames(along).body
    return tuple(rotations.to_body(rotation, v) for v in vectors)


def body_flux(
    body: Body,
    materials: Mapping[str, Material],
    sun_body: jax.Array,
    obs_body: jax.Array,
    which: NDArray[np.bool_] | None = None,
    visible: jax.Array | None = None,
) -> jax.Array:
    """Flux at unit distance under unit irradiance of directions in the body frame, m², (T,).

    Sum over the laws of the body's facets, or of those in ``which`` (N,); those of one law go
    together. ``visible`` (T, N) is the fraction of each facet that no other part shades or hides.
    A parameter that all materials of a law lack has the default of the law.
    """
    labels = np.array(body.labels)
    which = np.ones(labels.size, bool) if which is None else which
    used = [name for name in materials if name in set(labels[which])]
    total = jnp.zeros(sun_body.shape[0])
    for law in sorted({materials[name].law for name in used}):
        names = [name for name in used if materials[name].law == law]
        here = which & np.isin(labels, names)
        index = np.array([names.index(label) for label in labels[here]])
        each = [materials[name].parameters for name in names]
        params = {
            key: jnp.stack([jnp.asarray(p[key], float) for p in each])[index]
            for key in LAWS[law].parameters
            if any(key in p for p in each)
        }
        total += brightness.flux_brdf(
            sun_body,
            obs_body,
            jnp.asarray(body.normals[here]),
            jnp.asarray(body.areas[here]),
            law,
            params,
            jnp.asarray(body.u_axes[here]),
            None if visible is None else visible[:, here],
        )
    return total


def _in_units(scenario: Scenario, curve: LightCurve, flux: Floats) -> Floats:
    """Flux as the light curve has it: W/m² or at unit distance, or an apparent magnitude."""
    if curve.range_km is None:
        return flux
    range_m = jnp.asarray(1e3 * curve.range_km)
    lit = jnp.asarray(flux * earth_shadow.irradiance(curve))
    if scenario.kind == "mag":
        m_sun = photometry.sun_magnitude(scenario.band)
        return np.asarray(photometry.magnitude(lit, range_m, m_sun))
    return np.asarray(photometry.irradiance(lit, range_m))


def _noise_sd(scenario: Scenario, clean: Floats) -> Floats:
    """Standard deviation of every point, in the unit of the brightness."""
    kind, value = scenario.noise.kind, scenario.noise.value
    if scenario.kind == "mag":  # a relative error of a flux, for errors that are small
        return np.full(clean.size, MAGNITUDE_PER_NEPER / value if kind == "snr" else value)
    if kind == "mag_err":
        return clean * value / MAGNITUDE_PER_NEPER
    if kind == "sigma":
        return np.full(clean.size, value)
    if not clean.any():
        raise InputError(
            f"scenario {scenario.name!r}: no facet is lit and seen at any of {clean.size} epochs, "
            "so noise.snr has no meaning; give noise.sigma"
        )
    return np.full(clean.size, float(np.mean(clean)) / value)


def truth(
    scenario: Scenario, seed: int, curve: LightCurve, clean: Floats, n_dark: int
) -> dict[str, Any]:
    """What a perfect fit of the light curve would find, ready for JSON.

    Normals are given for body axes that are the inertial axes at the first point of the curve
    (``t_ref_s``), as Linares & Crassidis have them (A(t₀) = I), for a constant rate and for a
    torque-free body, whose ω and inertia tensor are given there too; for a principal-axis spin they
    are in its own body axes, z towards the pole, and so for laws of the catalogue, where those of
    facets that are ``on_array`` are in the array's axes. `albedo_area_m2` is None for facets whose
    reflectance is not one factor. A body of parts has `parts` and `shadows` in place of facets,
    always in its own body axes.
    """
    t_ref = float(curve.t[0])
    spin, turn = _attitude_truth(scenario.attitude, t_ref)
    used = set(scenario.body.labels)
    body = {"facets": _facets_truth(scenario, turn)}
    if scenario.parts is not None:
        body = parts.described(scenario.parts)
    return {
        "scenario": scenario.name,
        "seed": seed,
        "n_facets": len(scenario.body.areas),
        "n_obs": curve.n_obs,
        "n_dark_left_out": n_dark,
        "frame": curve.frame,
        "epoch_jd": curve.epoch_jd,
        "t_ref_s": t_ref,
        "attitude": spin,
        **body,
        "materials": {
            name: {"law": m.law, **m.parameters}
            for name, m in scenario.materials.items()
            if name in used
        },
        "noise": {scenario.noise.kind: scenario.noise.value},
        scenario.kind: clean.tolist(),
    }


def _facets_truth(scenario: Scenario, turn: Floats | None) -> list[dict[str, Any]]:
    """The facets as `truth` has them, turned from the body axes of the attitude law."""
    normals, u_axes = scenario.body.normals, scenario.body.u_axes
    if turn is not None:
        normals, u_axes = normals @ turn.T, u_axes @ turn.T
    phi, g = facets.angles(jnp.asarray(normals))
    return [
        {
            "normal": normals[i].tolist(),
            "u": u_axes[i].tolist(),
            "phi": float(phi[i]),
            "g": float(g[i]),
            "area_m2": float(area),
            "albedo_area_m2": _albedo_area(scenario, i),
            "material": scenario.body.labels[i],
            **({"on_array": scenario.on_array[i]} if scenario.on_array else {}),
        }
        for i, area in enumerate(scenario.body.areas)
    ]


def _attitude_truth(law: Attitude, t_ref: float) -> tuple[dict[str, Any], Floats | None]:
    """The law as `truth` has it, and the turn (3, 3) from its body axes to those of `truth`."""
    turn: Floats | None = None
    spin = {"law": law.name, **law.settings()}
    if isinstance(law, ConstantRate):
        omega = jnp.asarray(law.omega_rad_s)
        turn = np.asarray(rotations.constant_rate(jnp.array([t_ref]), omega)[0])
    elif isinstance(law, TorqueFree):
        when = Ephemeris(jnp.array([t_ref]), jnp.zeros((1, 3)))
        first, now = (law.frames(when._replace(t=t)).body[0] for t in (jnp.zeros(1), when.t))
        inertia = jnp.diag(jnp.asarray(law.inertia))
        momentum = first @ inertia @ first.T @ jnp.asarray(law.omega_rad_s)
        tensor = now @ inertia @ now.T
        turn = np.asarray(now)
        spin |= {
            "omega_at_t_ref_rad_s": jnp.linalg.solve(tensor, momentum).tolist(),
            "inertia_at_t_ref": tensor.tolist(),
            "angular_momentum": (momentum / jnp.linalg.norm(momentum)).tolist(),
        }
    elif isinstance(law, PrincipalAxis):
        spin = {
            "law": "principal-axis",
            "pole_lon_deg": law.pole_lon_deg,
            "pole_lat_deg": law.pole_lat_deg,
            "period_h": law.period_s / HOUR_S,
            "phase0_deg": law.phase0_deg,
        }
    return spin, turn


def _albedo_area(scenario: Scenario, i: int) -> float | None:
    """α of `brightness.flux`, where the facet's law is one of its kernels times a factor."""
    material = scenario.materials[scenario.body.labels[i]]
    area, p = float(scenario.body.areas[i]), material.parameters
    if material.law in ("lambertian", "non-lambertian"):
        return p["r_diff"] * area
    if material.law == "lommel-seeliger-lambert" and p["a"] == 0 and p["k"] == 0:
        return p["w"] * area / (4.0 * np.pi)
    return None


def sidecar(path: str | Path) -> Path:
    """Where the truth of a light-curve file is written: curve.csv → curve.truth.json."""
    return Path(path).with_suffix(".truth.json")
