"""The Fisher information against the paper's appendix, derivatives by hand and nothing of JAX.

Linares & Crassidis (A.1) as corrected (see docs/errata.md), the clipping of each cosine and the
factor Φ/r² put in, chained by hand to the unconstrained coordinates of the model ``faceted``. The
appendix has no derivative by ω: that comes from the left Jacobian of the rotation group.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lcbayes.core.jax_setup import jax, jnp
from tests.helpers import small_curves

Floats = NDArray[np.float64]

N, T = 3, 40
BASE = np.array([[0.9, -0.1, 0.3], [-0.15, 0.8, 0.6], [0.2, -0.3, 0.85]])  # lengths near one
LOG_AREA = np.array([1.6, 0.9, -0.4])
OMEGA_UNIT = np.array([0.9, -0.5, 0.6])
OMEGA_SD, LOG_AREA_SD, RADIUS_SD = 0.08, 0.7, 0.1
SUN_FLUX = 455.0  # W/m², visible band


def cross(v: Floats) -> Floats:
    x, y, z = v
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def left_jacobian(turn: Floats) -> Floats:
    """J with exp([(v + dv)×]) = exp([J dv ×]) exp([v×]), (3, 3)."""
    angle = np.linalg.norm(turn)
    if angle == 0.0:
        return np.eye(3)
    axis = turn / angle
    s = np.sin(angle) / angle
    return (
        s * np.eye(3) + (1 - s) * np.outer(axis, axis) + (1 - np.cos(angle)) / angle * cross(axis)
    )


def brightness_and_slopes(t: float, sun: Floats, obs: Floats, omega: Floats):
    """f and its derivatives by α (N,), φ (N,), g (N,) and ω (3,), of one epoch; and what is lit."""
    alpha = np.exp(LOG_AREA)
    rotation = Rotation.from_rotvec(omega * t).as_matrix()  # body to inertial
    f, by_omega, lit = 0.0, np.zeros(3), np.zeros(N, bool)
    by_alpha, by_phi, by_g = np.zeros((3, N))
    for i, b in enumerate(BASE):
        phi, g = np.arctan2(b[1], b[0]), b[2] / np.linalg.norm(b)
        side = np.sqrt(1 - g**2)
        u = rotation @ [np.cos(phi) * side, np.sin(phi) * side, g]
        u_phi = rotation @ [-np.sin(phi) * side, np.cos(phi) * side, 0.0]  # (A.1f), rotated
        u_g = rotation @ [-g * np.cos(phi) / side, -g * np.sin(phi) / side, 1.0]  # (A.1g)
        q, z = sun @ u, obs @ u
        if q <= 0 or z <= 0:
            continue
        lit[i] = True
        in_q, in_z = 1 - (1 - q / 2) ** 5, 1 - (1 - z / 2) ** 5
        c = in_q * in_z
        c1 = alpha[i] / np.pi * (2.5 * z * q * (1 - z / 2) ** 4 * in_q + c * q)  # (A.1d)
        c2 = alpha[i] / np.pi * (2.5 * z * q * (1 - q / 2) ** 4 * in_z + c * z)  # (A.1e)
        f += alpha[i] * c * z * q / np.pi
        by_alpha[i] = z * q * c / np.pi  # (A.1a)
        by_phi[i] = c1 * (obs @ u_phi) + c2 * (sun @ u_phi)  # (A.1b)
        by_g[i] = c1 * (obs @ u_g) + c2 * (sun @ u_g)  # (A.1c)
        u_omega = -cross(u) @ left_jacobian(omega * t) * t  # ∂(A u)/∂ω
        by_omega += c1 * (obs @ u_omega) + c2 * (sun @ u_omega)
    return f, (by_alpha, by_phi, by_g, by_omega), lit


def chained(by_alpha: Floats, by_phi: Floats, by_g: Floats, by_omega: Floats, spin: bool) -> Floats:
    """By ln α (N), the vectors b that carry the normals (3 N) and ω over its prior's sd (3)."""
    parts = [np.exp(LOG_AREA) * by_alpha]
    for i, b in enumerate(BASE):
        r = np.linalg.norm(b)
        phi_b = np.array([-b[1], b[0], 0.0]) / (b[0] ** 2 + b[1] ** 2)
        g_b = np.array([0.0, 0.0, 1.0]) / r - b[2] * b / r**3
        parts.append(by_phi[i] * phi_b + by_g[i] * g_b)
    if spin:
        parts.append(OMEGA_SD * by_omega)
    return np.concatenate(parts)


def prior(spin: bool) -> Floats:
    """Inverse variances: of ln α and ω, of b along its radius, and 3/r² across it."""
    blocks = [np.eye(N) / LOG_AREA_SD**2]
    for b in BASE:
        r = np.linalg.norm(b)
        along = np.outer(b, b) / r**2
        blocks.append(along / RADIUS_SD**2 + (np.eye(3) - along) * 3 / r**2)
    if spin:
        blocks.append(np.eye(3))
    n = sum(len(b) for b in blocks)
    result, at = np.zeros((n, n)), 0
    for b in blocks:
        result[at : at + len(b), at : at + len(b)] = b
        at += len(b)
    return result


CASES = {
    "at rest": {"spin": False},
    "turning": {"spin": True},
    "at a range": {"spin": True, "range_km": np.linspace(600.0, 1400.0, T)},
}


@pytest.mark.parametrize("case", CASES.values(), ids=CASES.keys())
def test_fisher_is_the_corrected_appendix(case):
    spin, range_km = case["spin"], case.get("range_km")
    factor = np.ones(T) if range_km is None else SUN_FLUX / (1e3 * range_km) ** 2
    error = factor * np.linspace(0.02, 0.08, T)
    light = small_curves.curve(T, error=error, range_km=range_km)
    problem, data = small_curves.posterior(
        light,
        n_facets=N,
        spin="free" if spin else "none",
        omega_sd=OMEGA_SD,
        log_area_sd=LOG_AREA_SD,
    )
    sites = {"normals_base": BASE, "log_albedo_area": LOG_AREA, "omega_unit": OMEGA_UNIT}
    z = problem.ravel({k: jnp.asarray(sites[k]) for k in problem.names})

    omega = spin * OMEGA_SD * OMEGA_UNIT
    jacobian, flux, lit = np.zeros((T, problem.dim)), np.zeros(T), np.zeros((T, N), bool)
    for k in range(T):
        f, slopes, lit[k] = brightness_and_slopes(light.t[k], light.sun[k], light.obs[k], omega)
        flux[k] = factor[k] * f
        jacobian[k] = factor[k] * chained(*slopes, spin)
    assert np.all(lit.any(axis=0))  # every facet shows at some epochs and not at others,
    assert not np.any(lit.all(axis=0))
    np.testing.assert_allclose(jax.jit(problem.moments)(z, data).mean, flux, rtol=1e-12)

    weighted = jacobian / error[:, None]
    want = weighted.T @ weighted + prior(spin)
    result = np.asarray(jax.jit(problem.fisher)(z, data))
    assert problem.names == tuple(sorted(problem.names))  # the order that `chained` keeps
    scale = np.sqrt(np.diag(want))
    np.testing.assert_allclose(
        result / np.outer(scale, scale), want / np.outer(scale, scale), atol=1e-10, rtol=0
    )
    # The data say more than the prior of all but the radii: it is (A.1) that is tested.
    assert np.sum(np.diag(weighted.T @ weighted) > np.diag(prior(spin))) >= problem.dim - N
