"""How finely a curved part is divided, from how exact its flux is to be."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache, partial

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.physics.bodies.primitives import Panels
from lcbayes.physics.brightness import flux_brdf

Floats = NDArray[np.float64]
type Surface = tuple[str, Mapping[str, float]]  # a law of reflectance and its parameters

TOLERANCE = 1e-3
MOST_PANELS = 20_000  # of a part
FIRST = 16
PROBES = 600  # pairs of directions
PHASE_DEG = 150.0  # the largest phase angle at which the error is that which is given
_BLOCK = 512  # panels at once
_MARGIN = 2.0  # over the difference that halving the panels makes, 4/3 for an error like 1/n²
_SEEN_AT = 97  # a division that shares no panel with those that are tried


class TooManyPanels(ValueError):
    """A surface so glossy that its highlights are narrower than panels can follow."""

    def __init__(self, error: float, count: int) -> None:
        super().__init__(f"{count:,} panels leave an error of {error:.1e}")
        self.error, self.count = error, count


def divide(
    make: Callable[[int], Panels], surfaces: Mapping[str, Surface], tolerance: float = TOLERANCE
) -> tuple[Panels, float]:
    """The coarsest division whose flux is right to a tolerance, and its error.

    n goes through 16, 24, 32, 48, … until the flux changes by less than half the tolerance where n
    is doubled, in the worst of `PROBES` pairs of directions to Sun and observer. Half of these are
    random; of the others the bisector is a normal of the surface, where a glossy surface glints.
    Phase angles are up to `PHASE_DEG`: beyond, the lit part that is seen is a crescent narrower
    than panels, and a glossy one is bright there.

    Parameters
    ----------
    make : n → Panels
    surfaces : side → law and parameters
    tolerance : float
        Of the flux without shadows, over the largest flux that the part has in any direction.

    Returns
    -------
    Panels
    float
        Twice that change, as a share of the largest flux: a bound on the error.

    Raises
    ------
    TooManyPanels
        Over `MOST_PANELS` would be needed.

    Examples
    --------
    >>> from lcbayes.physics.bodies.primitives import sphere
    >>> panels, error = divide(partial(sphere, 0.5), {"side": ("lambertian", {"r_diff": 1.0})})
    >>> error < 1e-3
    True
    """
    sun, obs = _probes(make(_SEEN_AT).normals)

    @lru_cache
    def flux(n: int) -> Floats:
        return unshadowed(make(n), surfaces, sun, obs)

    n = FIRST
    while True:
        error = _MARGIN * float(np.max(np.abs(flux(n) - flux(2 * n))) / flux(2 * n).max())
        if error <= tolerance:
            return make(n), error
        n = n * 3 // 2 if n & (n - 1) == 0 else n * 4 // 3
        count = len(make(n).areas)
        if count > MOST_PANELS:
            raise TooManyPanels(error, count)


def unshadowed(panels: Panels, surfaces: Mapping[str, Surface], sun: Floats, obs: Floats) -> Floats:
    """Flux at unit distance under unit irradiance of directions in the part's axes, m², (T,)."""
    total = np.zeros(len(sun))
    for side, (law, parameters) in surfaces.items():
        mine = np.flatnonzero([s == side for s in panels.sides])
        for block in np.array_split(mine, -(-len(mine) // _BLOCK)) if len(mine) else []:
            filled = np.concatenate([block, np.repeat(block[-1:], _BLOCK - len(block))])
            areas = np.where(np.arange(_BLOCK) < len(block), panels.areas[filled], 0.0)
            args = (sun, obs, panels.normals[filled], areas, panels.u_axes[filled])
            with jax.ensure_compile_time_eval():  # a number, also while a model is traced
                total += np.asarray(_flux(law, dict(parameters), *map(jnp.asarray, args)))
    return total


@partial(jax.jit, static_argnums=0)
def _flux(law, parameters, sun, obs, normals, areas, u_axes):
    return flux_brdf(sun, obs, normals, areas, law, parameters, u_axes)


def _probes(normals: Floats) -> tuple[Floats, Floats]:
    """Directions to Sun and observer, (PROBES, 3) each."""
    rng = np.random.default_rng(20261123)
    half = PROBES // 2
    bisector = np.concatenate(
        [rng.standard_normal((half, 3)), normals[rng.integers(len(normals), size=half)]]
    )
    bisector /= np.linalg.norm(bisector, axis=1, keepdims=True)
    bisector[half:] += 0.01 * rng.standard_normal((half, 3))
    across = np.cross(bisector, rng.standard_normal(bisector.shape))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    angle = np.deg2rad(rng.uniform(0.0, 0.5 * PHASE_DEG, (2 * half, 1)))
    sun, obs = bisector + np.tan(angle) * across, bisector - np.tan(angle) * across
    sun /= np.linalg.norm(sun, axis=1, keepdims=True)
    return sun, obs / np.linalg.norm(obs, axis=1, keepdims=True)
