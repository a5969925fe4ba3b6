"""Coordinates of an angular velocity whose rate the data fix far better than its direction."""

from __future__ import annotations

import numpy as np
from numpyro.distributions import constraints
from numpyro.distributions.transforms import Transform

from lcbayes.core.jax_setup import jax, jnp

MIN_TURNS = 50.0  # of a spin at the prior's sd, above which rate and direction are sampled


def rate_and_direction(
    spin: str, omega_sd: float, period: str, t_span: float
) -> dict[str, RateAndDirection] | None:
    """Coordinates of the site ``omega_unit`` for options of a model; None for its components.

    Rate and direction are sampled if the body may turn many times or its period is known. They are
    singular at ω = 0, so that bodies which may hardly turn keep the components.
    """
    many = omega_sd * t_span / (2.0 * np.pi) > MIN_TURNS
    return {"omega_unit": RateAndDirection()} if spin == "free" and (many or period) else None


class RateAndDirection(Transform):
    """(ln ω, X, Y) ↔ ω with the stereographic coordinates X, Y of its direction.

    Over n turns a light curve fixes the rate to a part in n, and the direction to degrees. In the
    components of ω the posterior is then a thin piece of the sphere of that rate: a tilt by δ along
    its tangent changes the phase by π n δ². Here the sphere is a plane. The direction
    p = (2X, 2Y, 1 − X² − Y²)/(1 + X² + Y²) has one singular point, −z, which has no volume, and
    angles are preserved everywhere.

    Parameters
    ----------
    unit : float
        ω at ln ω = 0, in the units of the site.
    """

    domain = constraints.real_vector  # pyright: ignore[reportAssignmentType]
    codomain = constraints.real_vector  # pyright: ignore[reportAssignmentType]

    def __init__(self, unit: float = 1.0) -> None:
        self.unit = unit

    def __call__(self, x: jax.Array) -> jax.Array:
        square = x[1] ** 2 + x[2] ** 2
        direction = jnp.stack([2.0 * x[1], 2.0 * x[2], 1.0 - square]) / (1.0 + square)
        return self.unit * jnp.exp(x[0]) * direction

    def _inverse(self, y: jax.Array) -> jax.Array:
        rate = jnp.sqrt(jnp.sum(y**2) + 1e-300)
        below = jnp.maximum(rate + y[2], 1e-12 * rate)
        return jnp.stack([jnp.log(rate / self.unit), y[0] / below, y[1] / below])

    def log_abs_det_jacobian(self, x: jax.Array, y: jax.Array, intermediates=None) -> jax.Array:  # noqa: ARG002
        """ln |∂ω/∂(ln ω, X, Y)| = ln (4 ω³/(1 + X² + Y²)²)."""
        square = x[1] ** 2 + x[2] ** 2
        return jnp.log(4.0) + 3.0 * (x[0] + jnp.log(self.unit)) - 2.0 * jnp.log1p(square)

    def tree_flatten(self):
        return (), ((), {"unit": self.unit})

    def __eq__(self, other: object) -> bool:
        return isinstance(other, RateAndDirection) and self.unit == other.unit

    def __hash__(self) -> int:
        return hash((RateAndDirection, self.unit))
