"""What is known of a spin before the fit: its period and a region of its pole, as a prior of ω."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpyro.distributions as dist
from numpy.typing import NDArray
from numpyro.distributions import constraints
from numpyro.distributions.util import validate_sample
from numpyro.util import is_prng_key

from lcbayes.core.durations import LISTED, NUMBER, UNITS, seconds
from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.geometry.spherical import unit_vector
from lcbayes.modelling.epochs import Epochs

Floats = NDArray[np.float64]

SINGLE_SD = 0.01  # relative, of a single period
RANGE_EDGE = 0.02  # sd of the edges of a range, relative to its length in ln P
POLE_EDGE = 0.05  # width of the edge of a region of poles, relative to its size in cos θ
REACH = 3.0  # sd of the edges within which a search covers the periods
MAX_SYNODIC = 1.0  # largest relative difference of a synodic period that a width includes
MIN_BISECTOR = 0.2  # |sun + obs| below which the bisector is poorly defined
EXAMPLES = "23.7s, 23.70+-0.02s or 20-30s"

_PERIOD = re.compile(
    rf"\s*({NUMBER})\s*([a-z]*)\s*(?:(\+-|±|-)\s*({NUMBER})\s*([a-z]*)\s*)?", re.IGNORECASE
)


@dataclass(frozen=True)
class Period:
    """A sidereal period that is possible.

    Attributes
    ----------
    low, high : s
        Equal for a single value.
    sd : s or None
        Of a single value; None if it was not given.
    """

    low: float
    high: float
    sd: float | None = None

    @property
    def single(self) -> bool:
        return self.low == self.high

    @classmethod
    def of(cls, text: str) -> Period:
        """A period from ``23.7s``, ``23.70+-0.02s`` or ``20-30s``.

        Raises
        ------
        InputError
        """
        match = _PERIOD.fullmatch(text)
        if match is None:
            raise InputError(f"the period {text.strip()!r} is not understood; give {EXAMPLES}")
        first, unit, sign, second, last = match.groups()
        unit, last = unit.lower(), (last or "").lower()
        unit, last = unit or last, last or unit
        if unit not in UNITS or last not in UNITS:
            raise InputError(
                f"the period {text.strip()!r} needs a unit, {LISTED}: such as {EXAMPLES}"
            )
        low = seconds(first + unit)
        high = low if second is None else seconds(second + last)
        if low <= 0 or high <= 0:
            raise InputError(f"the period {text.strip()!r} is not positive; give {EXAMPLES}")
        if sign != "-":
            return cls(low, low, None if second is None else high)
        if high <= low:
            raise InputError(
                f"the period {text.strip()!r} ends before it begins; give the shorter one first"
            )
        return cls(low, high)

    def width(self, drift: float | jax.Array) -> float | jax.Array:
        """Sd of ln P of a single value, or of the edges of a range.

        Parameters
        ----------
        drift : rad/s
            `bisector_rate`, by which the rates of a synodic and a sidereal period differ.
        """
        if self.sd is not None:
            return self.sd / self.low
        own = SINGLE_SD if self.single else RANGE_EDGE * math.log(self.high / self.low)
        synodic = drift * math.sqrt(self.low * self.high) / (2 * math.pi)
        synodic = jnp.minimum(synodic, MAX_SYNODIC)
        return (own**2 + synodic**2) ** 0.5

    def words(self, drift: float) -> str:
        """The period in words, with its width."""
        width = float(self.width(drift))
        if not self.single:
            edge = 100 * width
            return f"{self.low:.6g} to {self.high:.6g} s (ends uncertain by {edge:.2g} %)"
        return f"{self.low:.6g} ± {self.low * width:.2g} s"


@dataclass(frozen=True)
class PoleRegion:
    """Directions within a radius of a pole, or of the opposite direction.

    Attributes
    ----------
    ra, dec, radius : deg
    """

    ra: float
    dec: float
    radius: float

    @classmethod
    def of(cls, text: str) -> PoleRegion:
        """A region from ``RA,DEC,RADIUS`` in degrees.

        Raises
        ------
        InputError
        """
        try:
            ra, dec, radius = (float(part) for part in text.split(","))
        except ValueError:
            raise InputError(
                f"the pole is {text!r}; give RA,DEC,RADIUS in degrees, such as 120,-45,20"
            ) from None
        if not (-360 <= ra <= 360 and -90 <= dec <= 90):
            raise InputError(
                f"the pole is at RA {ra:g}, Dec {dec:g} deg; give a Dec from -90 to 90"
            )
        if not 0 < radius <= 90:
            raise InputError(
                f"the radius of the pole is {radius:g} deg; give more than 0, up to 90"
            )
        return cls(ra, dec, radius)

    @property
    def centre(self) -> Floats:
        """Unit vector (3,)."""
        return np.asarray(unit_vector(math.radians(self.ra), math.radians(self.dec)))

    @property
    def cosine(self) -> float:
        return math.cos(math.radians(self.radius))

    @property
    def edge(self) -> float:
        """Width of the edge in cos θ."""
        return POLE_EDGE * (1.0 - self.cosine)

    def within(self, directions: Floats, margin: float = 0.0) -> NDArray[np.bool_]:
        """Which directions (n, 3) lie in the region, enlarged by a margin (rad)."""
        reach = min(math.radians(self.radius) + margin, 0.5 * math.pi)
        return np.abs(directions @ self.centre) >= math.cos(reach) - 1e-12


@dataclass(frozen=True)
class KnownSpin:
    """What is known of a constant spin.

    Attributes
    ----------
    periods : tuple of Period
        Sidereal periods, each as likely as the others; empty if unknown.
    pole : PoleRegion or None
    """

    periods: tuple[Period, ...] = ()
    pole: PoleRegion | None = None

    @classmethod
    def of(cls, period: str = "", pole: str = "") -> KnownSpin | None:
        """From the options of a model, both of which may be empty; None if both are.

        Raises
        ------
        InputError

        Examples
        --------
        >>> KnownSpin.of("20-30s,1min").periods
        (Period(low=20.0, high=30.0, sd=None), Period(low=60.0, high=60.0, sd=None))
        """
        if not (period or pole):
            return None
        periods = tuple(Period.of(part) for part in period.split(",")) if period else ()
        return cls(periods, PoleRegion.of(pole) if pole else None)

    def check(self, spin: str) -> None:
        """Raise an InputError if a kind of spin has no such period or pole."""
        if spin == "none":
            raise InputError("a body that does not turn (--spin none) has no period and no pole")
        if spin == "torque-free" and self.pole is not None:
            raise InputError(
                "the angular velocity of a torque-free body has no fixed pole; leave --pole out"
            )

    def prior(self, omega_sd: float, data: Epochs) -> SpinPrior:
        """The prior of ω in units of ``omega_sd`` (rad/s) for the geometry of a light curve."""
        return SpinPrior(self, omega_sd, bisector_rate(data))

    def rates(self, drift: float) -> tuple[tuple[float, float], ...]:
        """Ranges of rates (rad/s) that contain all but 0.3 % of the prior, ascending, disjoint."""
        ends: list[tuple[float, float]] = []
        for p in self.periods:
            beyond = math.exp(REACH * float(p.width(drift)))
            ends.append((2 * math.pi / (p.high * beyond), 2 * math.pi / p.low * beyond))
        joined: list[tuple[float, float]] = []
        for low, high in sorted(ends):
            if joined and low <= joined[-1][1]:
                joined[-1] = joined[-1][0], max(high, joined[-1][1])
            else:
                joined.append((low, high))
        return tuple(joined)

    def sentences(self, drift: float, axes: str, *, constant: bool = True) -> Iterator[str]:
        """The prior in sentences.

        Parameters
        ----------
        drift : rad/s
            `bisector_rate`.
        axes : str
            The axes of the light curve.
        constant : bool
            Whether ω is constant.
        """
        if self.periods:
            listed = " or ".join(p.words(drift) for p in self.periods)
            what = "sidereal period" if constant else "period 2π/|ω| at the start"
            yield f"The {what} is {listed}, in either sense (--period)."
            if any(p.sd is None for p in self.periods):
                yield (
                    f"Its width includes {drift:.2g} rad/s, the typical rate of the phase-angle "
                    "bisector, by which a synodic period differs from it."
                )
        if self.pole is not None:
            p = self.pole
            yield (
                f"The pole, or the opposite direction, is within {p.radius:g} deg of RA {p.ra:g}, "
                f"Dec {p.dec:g} deg in {axes} (--pole)."
            )


class SpinPrior(dist.Distribution):
    """Prior of an angular velocity ω (3,), in units of ``unit``, from what is known of it.

    ln |ω| and the direction are independent. Each period gives ln |ω| = ln 2π − ln P with ln P
    uniform over its range, a single point for a single value, plus a normal error. Without a
    period, |ω| is that of N(0, unit² I). The direction is uniform in the region of the pole and
    its opposite, with the edge 1/(1 + exp(−(|cos θ| − cos R)/w)), or on the sphere.

    Parameters
    ----------
    known : KnownSpin
    unit : rad/s
    drift : rad/s
        `bisector_rate`.
    """

    support = constraints.real_vector  # pyright: ignore[reportAssignmentType]
    pytree_data_fields = ("drift",)
    pytree_aux_fields = ("known", "unit")

    def __init__(
        self,
        known: KnownSpin,
        unit: float,
        drift: float | jax.Array,
        *,
        validate_args: bool | None = None,
    ) -> None:
        self.known, self.unit, self.drift = known, unit, drift
        super().__init__(batch_shape=(), event_shape=(3,), validate_args=validate_args)

    def _components(self) -> list[tuple[float, float, float | jax.Array]]:
        """Middle and half-length of each range in ln |ω|, and the sd of the error."""
        return [
            (
                math.log(2 * math.pi / self.unit) - 0.5 * math.log(p.low * p.high),
                0.5 * math.log(p.high / p.low),
                p.width(self.drift),
            )
            for p in self.known.periods
        ]

    def sample(self, key: jax.Array, sample_shape: tuple[int, ...] = ()) -> jax.Array:
        assert is_prng_key(key)
        keys = jax.random.split(key, 6)
        vector = jax.random.normal(keys[0], (*sample_shape, 3))
        rate = jnp.linalg.norm(vector, axis=-1)
        direction = vector / rate[..., None]
        if self.known.periods:
            middle, half, sd = (jnp.stack(x) for x in zip(*self._arrays(), strict=True))
            which = jax.random.randint(keys[1], sample_shape, 0, middle.size)
            flat = jax.random.uniform(keys[2], sample_shape, minval=-1.0, maxval=1.0)
            error = jax.random.normal(keys[3], sample_shape)
            rate = jnp.exp(middle[which] + half[which] * flat + sd[which] * error)
        if self.known.pole is not None:
            direction = _drawn(self.known.pole, direction, keys[4], keys[5])
        return rate[..., None] * direction

    @validate_sample
    def log_prob(self, value: jax.Array) -> jax.Array:
        rate = jnp.sqrt(jnp.sum(value**2, axis=-1) + 1e-30)
        if self.known.periods:
            along = self._log_rate(jnp.log(rate)) - 3.0 * jnp.log(rate) - jnp.log(4 * jnp.pi)
        else:
            along = -0.5 * rate**2 - 1.5 * jnp.log(2 * jnp.pi)
        if self.known.pole is None:
            return along
        cosine = value @ self.known.pole.centre / rate
        return along + _log_region(self.known.pole, cosine) + jnp.log(2.0)

    def precision(self, value: jax.Array) -> jax.Array:
        """Precision (3, 3): inverse variances of |ω| and, across, of the direction times |ω|.

        The curvature of −log p is not used, because it does not measure the width of a flat prior.
        """
        square = jnp.sum(value**2) + 1e-30
        along = jnp.outer(value, value) / square
        radial = jnp.ones(())
        if self.known.periods:
            x = 0.5 * jnp.log(square)
            middle, half, sd = (jnp.stack(part) for part in zip(*self._arrays(), strict=True))
            variance = half**2 / 3.0 + sd**2
            near = jax.nn.softmax(-0.5 * (x - middle) ** 2 / variance - 0.5 * jnp.log(variance))
            radial = near @ (1.0 / variance) / square
        across = 3.0 / square if self.known.periods else jnp.ones(())
        if self.known.pole is not None:
            c = self.known.pole.cosine
            across = jnp.maximum(across, 6.0 / ((1.0 - c) * (2.0 + c)) / square)
        return radial * along + across * (jnp.eye(3) - along)

    def _arrays(self) -> list[tuple[jax.Array, jax.Array, jax.Array]]:
        return [(jnp.asarray(m), jnp.asarray(h), jnp.asarray(s)) for m, h, s in self._components()]

    def _log_rate(self, x: jax.Array) -> jax.Array:
        """ln p of ln |ω|."""
        parts = []
        for middle, half, sd in self._components():
            if half == 0.0:
                parts.append(dist.Normal(middle, sd).log_prob(x))
                continue
            # The density is symmetric: the lower half avoids differences of numbers close to one.
            y = -jnp.abs(x - middle)
            upper = jax.scipy.special.log_ndtr((y + half) / sd)
            lower = jax.scipy.special.log_ndtr((y - half) / sd)
            parts.append(upper + jnp.log1p(-jnp.exp(lower - upper)) - math.log(2.0 * half))
        return jax.scipy.special.logsumexp(jnp.stack(parts), axis=0) - math.log(len(parts))


class RatePrior(dist.Distribution):
    """Prior of a rate about an axis of the body, positive or negative, from that of ω.

    Parameters
    ----------
    omega : SpinPrior
        Without a region of poles. The rate has its distribution of |ω|, and both senses are alike.
    """

    support = constraints.real  # pyright: ignore[reportAssignmentType]
    pytree_data_fields = ("omega",)

    def __init__(self, omega: SpinPrior, *, validate_args: bool | None = None) -> None:
        self.omega = omega
        super().__init__(batch_shape=(), event_shape=(), validate_args=validate_args)

    def sample(self, key: jax.Array, sample_shape: tuple[int, ...] = ()) -> jax.Array:
        assert is_prng_key(key)
        key_size, key_sense = jax.random.split(key)
        size = jnp.linalg.norm(self.omega.sample(key_size, sample_shape), axis=-1)
        return size * jnp.where(jax.random.bernoulli(key_sense, 0.5, sample_shape), 1.0, -1.0)

    @validate_sample
    def log_prob(self, value: jax.Array) -> jax.Array:
        """Half the density of ω, integrated over its directions: 2π s² p(s n)."""
        square = jnp.square(value) + 1e-30
        return self.omega.log_prob(_upward(value)) + jnp.log(2.0 * jnp.pi * square)

    def precision(self, value: jax.Array) -> jax.Array:
        """Precision (1, 1), an inverse variance."""
        return self.omega.precision(_upward(value))[-1:, -1:]


def _upward(rate: jax.Array) -> jax.Array:
    """Vectors (..., 3) along z of these lengths (...)."""
    return jnp.asarray(rate)[..., None] * jnp.array([0.0, 0.0, 1.0])


def bisector_rate(data: Epochs) -> jax.Array:
    """Median rate of the phase-angle bisector, rad/s; zero if rates are unknown.

    The frequency of a light curve's features, the synodic one, differs from the sidereal frequency
    by the rate at which the bisector moves around the pole, which is of this size.
    """
    total = data.sun + data.obs
    length = jnp.maximum(jnp.linalg.norm(total, axis=1, keepdims=True), MIN_BISECTOR)
    bisector, change = total / length, (data.sun_rate + data.obs_rate) / length
    across = change - jnp.sum(change * bisector, axis=1, keepdims=True) * bisector
    return jnp.median(jnp.linalg.norm(across, axis=1))


def _norm(pole: PoleRegion) -> float:
    """∫ of the edge function over cos θ from −1 to 1."""
    c, w = pole.cosine, pole.edge
    return w * float(np.logaddexp(0.0, (1.0 - c) / w) - np.logaddexp(0.0, (-1.0 - c) / w))


def _log_region(pole: PoleRegion, cosine: jax.Array) -> jax.Array:
    """ln p of cos θ in −1 … 1 for a pole and its opposite."""
    c, w = pole.cosine, pole.edge
    both = jnp.logaddexp(
        jax.nn.log_sigmoid((cosine - c) / w), jax.nn.log_sigmoid((-cosine - c) / w)
    )
    return both - math.log(2.0 * _norm(pole))


def _drawn(
    pole: PoleRegion, direction: jax.Array, key: jax.Array, key_sense: jax.Array
) -> jax.Array:
    """Directions (..., 3) in the region, from those uniform on the sphere, by inverse CDF."""
    c, w, centre = pole.cosine, pole.edge, jnp.asarray(pole.centre)
    u = jax.random.uniform(key, direction.shape[:-1])
    low = float(np.logaddexp(0.0, (-1.0 - c) / w))
    area = low + u * _norm(pole) / w  # softplus of (cos θ − cos R)/w
    cosine = jnp.clip(c + w * (area + jnp.log(-jnp.expm1(-area))), -1.0, 1.0)
    cosine *= jnp.where(jax.random.bernoulli(key_sense, 0.5, cosine.shape), 1.0, -1.0)
    aside = direction - (direction @ centre)[..., None] * centre
    aside = aside / jnp.linalg.norm(aside, axis=-1, keepdims=True)
    return cosine[..., None] * centre + jnp.sqrt(1.0 - cosine**2)[..., None] * aside
