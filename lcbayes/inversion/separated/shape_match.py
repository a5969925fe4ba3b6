"""Match of candidate shapes to the observed distribution of brightness with phase angle.

The brightness of a body in many unrelated orientations is random. Its distribution depends on the
shape and the phase angle. Candidates are oriented at random and illuminated at the observed phase
angles, and noise is added. The distribution of the observations in the plane of phase angle and
magnitude is then compared with that of the candidates. Size and albedo are unknown, so magnitudes
are relative to their median. p-values are ranks among samples of the candidate itself, in two
states of motion. In the first, every point has an independent orientation, as for a tumbling body
observed over a long time. In the second, the body spins about one fixed axis. The axis and the
orientation of the body relative to it are drawn for each sample; the directions are those of the
observations, and rotational phases are unrelated. A candidate is rejected if it is rejected for
both states of motion. A rejection always refers to the shape together with the assumed surface.

References
----------
Hall et al. 2007, sec. 5 and fig. 3.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.progress import Silent
from lcbayes.core.reasons import Finding
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.separated.conditions import (
    REACH_MAG,
    STABLE_P,
    STABLE_RATIO,
    correlated,
    phase_angles,
    stabilised,
)
from lcbayes.inversion.separated.reduced import Floats, Ints, Reduced, reduce
from lcbayes.inversion.separated.two_samples import Reference
from lcbayes.physics.bodies import shapes
from lcbayes.physics.brightness import flux_brdf

R_DIFF, R_SPEC, EXPONENT = 0.3, 0.3, 100.0
LEAST_SNR = 3.0
LEAST_LEVEL = 0.001  # smallest level; requires 2000 null samples
MIN_INDEPENDENT, MOST_POINTS, LEAST_SPAN_DEG = 100, 500, 30.0
MANY_ROUND = 400  # facets of a sphere, so that its lobes overlap
BLOCK = 500_000  # facets × samples processed at once
STEP_DEG, TURNS = 1.0, 240  # spacing of sampled phase angles; orientations at each


@cache
def candidates() -> dict[str, shapes.Body]:
    """The built-in shapes; the cylinder is three times as long as wide."""
    return {
        "cube": shapes.cube(),
        "tetrahedron": shapes.tetrahedron(),
        "cylinder": shapes.cylinder(0.5, 3.0, 72),
        "sphere": shapes.sphere(0.5, MANY_ROUND),
        "plate": shapes.plate(),
        "box-wing": shapes.box_wing(),
        "rocket-body": shapes.rocket_body(n=72),
    }


@dataclass(frozen=True)
class Surface:
    """Blinn-Phong law, the same for all facets; a large exponent corresponds to a mirror."""

    r_diff: float = R_DIFF
    r_spec: float = R_SPEC
    exponent: float = EXPONENT

    def __post_init__(self) -> None:
        if min(self.r_diff, self.r_spec) < 0 or not 0 < self.r_diff + self.r_spec <= 1:
            raise InputError(
                f"r_diff {self.r_diff:g} and r_spec {self.r_spec:g}: expected numbers >= 0 whose "
                "sum is at most 1"
            )
        if not 1.0 <= self.exponent <= 1000.0:
            raise InputError(f"the exponent is {self.exponent:g}; expected 1 .. 1000")


@dataclass(frozen=True)
class Match:
    """Comparison of a candidate with the observations.

    Attributes
    ----------
    name : of the candidate
    p_kolmogorov, p_energy : probability of a distance at least as large if this is the shape and
        its orientation is random at every point
    p_fixed_axis : the same for a spin about a fixed axis, for both distances combined
    kolmogorov, energy : distances
    excess : energy distance above its mean under the candidate, in standard deviations
    phase, magnitude : (M,) rad, mag
        Draws of the candidate, with magnitudes relative to their median.
    """

    name: str
    p_kolmogorov: float
    p_energy: float
    p_fixed_axis: float
    kolmogorov: float
    energy: float
    excess: float
    phase: Floats
    magnitude: Floats

    @property
    def p_random(self) -> float:
        """Combined p-value of both tests (Bonferroni) for random orientations."""
        return min(1.0, 2.0 * min(self.p_kolmogorov, self.p_energy))

    @property
    def p_value(self) -> float:
        """p-value of the shape for any motion: the larger of the two states of motion."""
        return max(self.p_random, self.p_fixed_axis)


@dataclass(frozen=True)
class ShapeMatch:
    """All candidates, the best match first.

    Attributes
    ----------
    matches : by p-value, then by ``excess``
    level : probability below which a candidate is rejected
    surface : of all candidates
    phase, magnitude : (n,) rad, mag
        Observations used, with magnitudes relative to their median.
    n_obs, n_faint, stride : number of points; points excluded below 3σ; every stride-th is used
    correlation : number of points per independent point
    reasons : conditions that are not met
    """

    matches: tuple[Match, ...]
    level: float
    surface: Surface
    phase: Floats
    magnitude: Floats
    n_obs: int
    n_faint: int
    stride: int
    correlation: float
    reasons: list[Finding]

    @property
    def consistent(self) -> list[Match]:
        """Candidates that are not rejected."""
        return [m for m in self.matches if m.p_value >= self.level]


def shape_match(
    curve: LightCurve,
    bodies: Mapping[str, shapes.Body] | None = None,
    *,
    surface: Surface | None = None,
    level: float = 0.05,
    n_nulls: int | None = None,
    n_draws: int = 8000,
    seed: int = 0,
    progress: Silent | None = None,
) -> ShapeMatch:
    """Compare the phase-angle/brightness distribution with those of candidate shapes.

    Parameters
    ----------
    curve : LightCurve
        Calibrated light curve of one object, with all points on one scale.
    bodies : name → body; the built-in shapes when None
    surface : of the candidates
    level : a candidate is rejected below this p-value
    n_nulls : number of null samples; no p-value is below 2/(1 + n_nulls). By default 199, or more
        if the level requires it.
    n_draws : number of draws that represent a distribution

    Raises
    ------
    InputError
        No errors, several unknown scales, too few points, or an option out of range. This includes
        fewer null samples than a rejection at the level requires.
    """
    if not LEAST_LEVEL <= level < 1.0:
        raise InputError(f"the level is {level:g}; expected {LEAST_LEVEL:g} <= level < 1")
    least = max(39, int(2.0 / level))  # null samples: 2/(1 + least) is below the level
    n_nulls = max(199, least) if n_nulls is None else n_nulls
    if n_nulls < least or n_draws < 1000:
        raise InputError(
            f"expected n_draws >= 1000, and n_nulls >= {least} to reject at the level {level:g}"
        )
    seen = reduce(curve)
    if len(np.unique(seen.group)) > 1:
        raise InputError(
            f"the light curve has {len(np.unique(seen.group))} scales (curves of unknown scale, or "
            "bands), and the distribution needs one; give one of them"
        )
    progress = progress or Silent()
    surface = surface or Surface()
    bright = seen.flux > (LEAST_SNR * seen.error if curve.kind == "flux" else 0.0)
    n_obs, n_faint = len(seen.t), int(np.sum(~bright))
    seen = seen.at(np.flatnonzero(bright))
    if len(seen.t) < 20:
        raise InputError(f"{len(seen.t)} points are brighter than their noise; 20 are needed")
    correlation = correlated(seen)
    stride = max(int(np.ceil(correlation)), int(np.ceil(len(seen.t) / MOST_POINTS)))
    seen = seen.at(np.arange(0, len(seen.t), stride))
    rng = np.random.default_rng(seed)
    phase, magnitude = phase_angles(seen), -2.5 * np.log10(seen.flux)
    magnitude = magnitude - np.median(magnitude)
    reasons = _reasons(curve, seen, phase, magnitude, rng)
    observations = Observations(seen, phase, magnitude, curve.kind, n_nulls, n_draws)
    bodies = candidates() if bodies is None else bodies
    matches = []
    with progress.stage("matching shapes", len(bodies), "shapes") as track:
        for name, body in bodies.items():
            rng = np.random.default_rng(seed)
            matches.append(_match(name, body, surface, observations, rng))
            track.advance(1, name)
    matches.sort(key=lambda m: (-min(m.p_value, level), m.excess))
    return ShapeMatch(
        tuple(matches),
        level,
        surface,
        phase,
        magnitude,
        n_obs,
        n_faint,
        stride,
        correlation,
        reasons,
    )


def _reasons(
    curve: LightCurve, seen: Reduced, phase: Floats, magnitude: Floats, rng: np.random.Generator
) -> list[Finding]:
    out = []
    if len(phase) < MIN_INDEPENDENT:
        values = {"count": len(phase), "least": MIN_INDEPENDENT}
        out.append(Finding("too-few-independent-points", values))
    span = float(np.degrees(np.subtract(*np.quantile(phase, [0.95, 0.05]))))
    if span < LEAST_SPAN_DEG:
        values = {"span_deg": span, "least_deg": LEAST_SPAN_DEG}
        out.append(Finding("narrow-phase-angles", values))
    stable, law, ratio = stabilised(curve, seen, phase, magnitude, rng)
    if stable < STABLE_P and ratio < STABLE_RATIO:
        values = {"law": law, "p_value": stable, "percent": 100 * ratio}
        out.append(Finding("stabilised", values))
    return out


def turned(phase: Floats, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Directions to Sun and observer (n, 3) at these phase angles, with uniform orientation."""
    sun = rng.normal(size=(len(phase), 3))
    sun /= np.linalg.norm(sun, axis=1, keepdims=True)
    side = rng.normal(size=sun.shape)
    side -= np.sum(side * sun, axis=1, keepdims=True) * sun
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    return sun, np.cos(phase)[:, None] * sun + np.sin(phase)[:, None] * side


class PhaseSample:
    """Brightness of a shape at every phase angle, for a fixed set of random orientations.

    A draw uses one of the two sampled angles adjacent to the requested one; the nearer angle is the
    more probable. This is equivalent to an uncertainty of `STEP_DEG` in the phase angle.
    """

    def __init__(self, body: shapes.Body, surface: Surface) -> None:
        self.angles = np.radians(np.arange(0.0, 180.0 + STEP_DEG / 2, STEP_DEG))
        rng = np.random.default_rng(0)
        flux = reflected_flux(body, surface, *turned(np.repeat(self.angles, TURNS), rng))
        self.flux = flux.reshape(-1, TURNS)

    def draw(self, phase: Floats, rng: np.random.Generator) -> Floats:
        """Flux of the shape in a random orientation at each phase angle (rad), m²."""
        place = phase / np.radians(STEP_DEG)
        node = np.minimum((place + rng.random(len(phase))).astype(int), len(self.angles) - 1)
        return self.flux[node, rng.integers(TURNS, size=len(phase))]


_SAMPLES: dict[tuple[int, Surface], tuple[shapes.Body, PhaseSample]] = {}


def phase_sample(body: shapes.Body, surface: Surface) -> PhaseSample:
    """The `PhaseSample` of a body, cached for the lifetime of the body."""
    key = id(body), surface
    if key not in _SAMPLES or _SAMPLES[key][0] is not body:
        if len(_SAMPLES) > 64:
            _SAMPLES.clear()
        _SAMPLES[key] = body, PhaseSample(body, surface)
    return _SAMPLES[key][1]


def reflected_flux(body: shapes.Body, surface: Surface, sun: Floats, obs: Floats) -> Floats:
    """Flux at unit distance under unit irradiance, m², (n,)."""
    n, count = len(sun), len(body.areas)
    block = max(1, BLOCK // count)
    padded = -(-n // block) * block
    rows = np.arange(padded) % n
    normals, areas = jnp.asarray(body.normals), jnp.asarray(body.areas)
    values = [
        _block(
            jnp.asarray(sun[rows[i : i + block]]),
            jnp.asarray(obs[rows[i : i + block]]),
            normals,
            areas,
            surface.r_diff,
            surface.r_spec,
            surface.exponent,
        )
        for i in range(0, padded, block)
    ]
    return np.concatenate([np.asarray(v) for v in values])[:n]


@jax.jit
def _block(sun, obs, normals, areas, r_diff, r_spec, exponent):
    params = {"r_diff": r_diff, "r_spec": r_spec, "n": exponent}
    return flux_brdf(sun, obs, normals, areas, "blinn-phong", params)


@dataclass(frozen=True)
class Observations:
    """Data for the comparison with every candidate, and the numbers of samples.

    Attributes
    ----------
    seen : Reduced
    phase, magnitude : (n,) rad, mag
        Magnitudes are relative to their median.
    kind : of the light curve's brightness
    n_nulls, n_draws : number of null samples, and of draws that represent a distribution
    """

    seen: Reduced
    phase: Floats
    magnitude: Floats
    kind: str
    n_nulls: int
    n_draws: int


def _match(
    name: str, body: shapes.Body, surface: Surface, of: Observations, rng: np.random.Generator
) -> Match:
    """Compare one candidate with the observations."""
    n, phase = len(of.phase), of.phase
    # one observed point per draw, each equally often: the same distribution of phase angles
    which = np.arange(3 * of.n_draws) % n
    flux = phase_sample(body, surface).draw(phase[which], rng)
    values, kept = _noisy(flux * _level(flux, of.seen), which, of.kind, of.seen, rng)
    which, values = which[kept], values[kept]
    if len(values) < 2 * n:
        return Match(name, 0.0, 0.0, 0.0, 1.0, np.inf, np.inf, phase[which], values)
    draws = rng.permutation(len(values))[: of.n_draws]
    middle = float(np.median(values[draws]))
    where, y = phase[which[draws]], values[draws] - middle
    unit = np.array([np.std(phase), np.std(np.clip(y, -REACH_MAG, REACH_MAG))])
    low = np.array([phase.min() - 1e-9, -REACH_MAG]) / unit
    high = np.array([phase.max() + 1e-9, REACH_MAG]) / unit
    reference = Reference(np.stack([where, y], axis=1) / unit, low, high)
    at_random = _random_samples(which, values, of, rng)
    spinning = _spinning_samples(body, surface, of, rng)
    samples = [(phase, of.magnitude), *at_random, *spinning]
    distances = np.stack(
        reference.distances([np.stack(sample, axis=1) / unit for sample in samples]), axis=1
    )
    own, null = distances[0], distances[1 : 1 + of.n_nulls]
    p = (1 + np.sum(null >= own, axis=0)) / (1 + of.n_nulls)
    fixed = distances[1 + of.n_nulls :]
    p_fixed = (1 + np.sum(fixed >= own, axis=0)) / (1 + len(fixed))
    excess = (own[1] - null[:, 1].mean()) / null[:, 1].std()
    return Match(
        name,
        float(p[0]),
        float(p[1]),
        min(1.0, 2.0 * float(p_fixed.min())),
        float(own[0]),
        float(own[1]),
        float(excess),
        where,
        y,
    )


def _random_samples(
    which: Ints, values: Floats, of: Observations, rng: np.random.Generator
) -> list[tuple[Floats, Floats]]:
    """Phase angles and magnitudes of samples of a candidate whose orientation is random."""
    n = len(of.phase)
    by_point = np.argsort(which, kind="stable")
    # each observed point once, if it is bright enough in some draw
    count = np.bincount(which, minlength=n)
    bright = np.flatnonzero(count)
    begin = np.searchsorted(which[by_point], bright)
    samples = []
    for _ in range(of.n_nulls):
        chosen = by_point[begin + (rng.random(n)[bright] * count[bright]).astype(int)]
        again = values[chosen]
        samples.append((of.phase[bright], again - np.median(again)))
    return samples


def _spinning_samples(
    body: shapes.Body, surface: Surface, of: Observations, rng: np.random.Generator
) -> list[tuple[Floats, Floats]]:
    """The same for a candidate that spins about an axis fixed in space and in the body."""
    n = len(of.phase)
    sun, obs = np.empty((of.n_nulls, n, 3)), np.empty((of.n_nulls, n, 3))
    for k in range(of.n_nulls):
        axis, second = Rotation.random(2, rng)
        spin = Rotation.from_rotvec(rng.uniform(0.0, 2.0 * np.pi, (n, 1)) * [[0.0, 0.0, 1.0]])
        turn = axis * spin * second  # body to inertial
        sun[k], obs[k] = (
            turn.apply(of.seen.sun, inverse=True),
            turn.apply(of.seen.obs, inverse=True),
        )
    flux = reflected_flux(body, surface, sun.reshape(-1, 3), obs.reshape(-1, 3)).reshape(
        of.n_nulls, n
    )
    samples = []
    for one in flux:
        magnitude, kept = _noisy(one * _level(one, of.seen), np.arange(n), of.kind, of.seen, rng)
        if np.sum(kept) < 2:
            continue
        magnitude = magnitude[kept]
        samples.append((of.phase[kept], magnitude - np.median(magnitude)))
    return samples


def _level(flux: Floats, seen: Reduced) -> float:
    """Factor that scales the median flux of the candidate to that of the observations."""
    bright = flux[flux > 0]
    return float(np.median(seen.flux) / np.median(bright)) if bright.size else 1.0


def _noisy(
    flux: Floats, which: Ints, kind: str, seen: Reduced, rng: np.random.Generator
) -> tuple[Floats, NDArray[np.bool_]]:
    """Magnitudes with the noise of the observations, and whether each would be observed."""
    noise = rng.standard_normal(len(flux))
    error = seen.error[which]
    with np.errstate(divide="ignore", invalid="ignore"):
        if kind == "mag":
            relative = (seen.error / seen.flux)[which]
            kept = flux > 0
            return -2.5 * np.log10(flux) + 2.5 / np.log(10.0) * relative * noise, kept
        measured = flux + error * noise
        return -2.5 * np.log10(measured), measured > LEAST_SNR * error
