"""Outlines of an asteroid's posterior over the chords of occultations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp, softmax

from lcbayes.core.errors import InputError
from lcbayes.core.progress import Silent
from lcbayes.core.reasons import Finding
from lcbayes.data.formats.occultation import Occultation
from lcbayes.inversion import occultations
from lcbayes.inversion.occultations import Chords, Placed
from lcbayes.results.asteroid import ECLIPTIC, Asteroid, row
from lcbayes.results.content import BodyRow

Floats = NDArray[np.float64]

MIN_EFFECTIVE = 20.0  # effective number of bodies below which the chords choose too few
SAMPLES = 25  # of the size of each body, given its shape, and of its relief
ANGLES = 180  # at which outlines are compared
BAND = (0.05, 0.5, 0.95)


@dataclass(frozen=True)
class Outline:
    """The bodies of one solution over the chords.

    Attributes
    ----------
    asteroid : Asteroid
    n_failed : int
        Draws without a convex body.
    placed : Placed
        For each body, in km.
    outline : (S, C, D)
        Support functions, in units of the volume-equivalent diameter.
    chords : Chords
    posterior : float
        Weight of the solution after the chords.
    joint : (S,)
        Weights of the bodies after the chords; their sum is one.
    effective : float
        Effective number of bodies with these weights.
    """

    asteroid: Asteroid
    n_failed: int
    placed: Placed
    outline: Floats
    chords: Chords
    posterior: float
    joint: Floats
    effective: float

    @property
    def log_evidence(self) -> float:
        """ln p(chords | solution): the likelihood of the chords, averaged over the bodies."""
        each = self.placed.log_likelihood
        return float(logsumexp(each) - np.log(len(each)))

    def inside(self, *, relief: bool) -> NDArray[np.bool_]:
        """Whether each end lies in the central 90 % of the outlines, timing error included, (E,).

        Shapes are from light curves alone; only size and centre are fitted to the chords. With
        ``relief``, the limb deviates from each outline as it does before the chords are known.
        """
        rng = np.random.default_rng(0)  # the same in every table and figure
        timing = np.linalg.norm(self.chords.along_km, axis=1)
        drawn = self.placed.distance + timing * rng.standard_normal(self.placed.distance.shape)
        if relief:
            drawn += self._rms_heights(rng) * rng.standard_normal(drawn.shape)
        low, high = np.quantile(drawn, (BAND[0], BAND[-1]), axis=0)
        return (low <= 0.0) & (high >= 0.0)

    def diameter(self, seed: int = 0, *, joint: bool) -> BodyRow:
        """The volume-equivalent diameter, km; with ``joint``, bodies have their weights."""
        drawn, weight = self.diameters(seed, joint=joint)
        return weighted_row(drawn, weight)

    def diameters(self, seed: int = 0, *, joint: bool) -> tuple[Floats, Floats]:
        """Draws of the diameter, km, and their weights, which sum to one."""
        rng = np.random.default_rng(seed)
        count = len(self.placed.size)
        noise = rng.standard_normal((SAMPLES, count))
        drawn = self.placed.size + self.placed.size_sd * noise
        each = self.joint if joint else np.full(count, 1.0 / count)
        return drawn.ravel(), np.tile(each / SAMPLES, SAMPLES)

    def middle(self, event: int) -> Floats:
        """The mean centre of an event, (2,) km."""
        return self.placed.centre[:, event].mean(axis=0)

    def _rms_heights(self, rng: np.random.Generator) -> Floats:
        """Rms height of the limb over each outline, km, from its prior: (S, 1)."""
        drawn = rng.standard_normal((len(self.placed.size), 1))
        share = occultations.RELIEF_MEDIAN * np.exp(occultations.RELIEF_LOG_SD * drawn)
        return share * self.placed.size[:, None] * self.outline.mean(axis=(1, 2))[:, None]

    def band(self, event: int) -> tuple[Floats, Floats, Floats]:
        """Angles from x to y, (A,) rad, and radii about `middle` at the quantiles `BAND`, km.

        The radii are those of the outlines (3, A) in the orientation at the median chord, and of
        the limb (3, A), which has relief over them.
        """
        chords = np.flatnonzero(self.chords.chord_event == event)
        angle = 2.0 * np.pi * np.arange(occultations.DIRECTIONS) / occultations.DIRECTIONS
        normal = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        shift = self.placed.centre[:, event] - self.middle(event)
        shape = self.outline[:, chords[len(chords) // 2]]
        height = self.placed.size[:, None] * shape + shift @ normal.T
        toward = 2.0 * np.pi * np.arange(ANGLES) / ANGLES
        radii = np.stack([radius(height, angle, float(a)) for a in toward], axis=1)
        rng = np.random.default_rng(0)  # the same in every table and figure
        rms = np.concatenate([self._rms_heights(rng) for _ in range(SAMPLES)])
        limb = np.tile(radii, (SAMPLES, 1)) + rms * rng.standard_normal((len(rms), ANGLES))
        return toward, np.quantile(radii, BAND, axis=0), np.quantile(limb, BAND, axis=0)


def radius(height: Floats, angle: Floats, toward: float) -> Floats:
    """Distance of the outline from the origin in a direction, from its support function.

    r = min h(θ)/cos(θ − φ) over the half circle, for outlines (S, D) that hold the origin.
    """
    cosine = np.cos(angle - toward)
    facing = cosine > 0.05
    return np.min(height[:, facing] / cosine[facing], axis=1)


def outlines(
    asteroids: Sequence[Asteroid],
    events: Sequence[Occultation],
    num_bodies: int,
    progress: Silent,
) -> list[Outline]:
    """Place the bodies of each solution over the chords, and weight them by their likelihood.

    Raises
    ------
    InputError
        The fit is not in ecliptic axes, or no draw has a convex body.
    """
    if asteroids[0].frame != ECLIPTIC:
        raise InputError(
            f"the fit is in the frame {asteroids[0].frame}, and occultations are in ecliptic "
            "J2000; fit light curves with ecliptic directions, such as DAMIT files"
        )
    chords = Chords.of(events)
    placed_outlines: list[tuple[Asteroid, int, Placed, Floats]] = []
    for number, asteroid in enumerate(asteroids, 1):
        progress.say(f"solution {number}: {num_bodies} bodies over {len(chords.ends) // 2} chords")
        bodies, failed = asteroid.bodies(num_bodies)
        if not bodies:
            raise InputError(
                f"no draw of solution {number} has a convex body: its areas do not close; "
                "run `lcbayes fit` with more normals"
            )
        each = [[occultations.support(b.body.vertices, b.spin, e) for e in events] for b in bodies]
        outline = np.stack([np.concatenate([o for o, _ in one]) for one in each])
        across = np.stack([np.concatenate([a for _, a in one]) for one in each])
        placed_outlines.append(
            (asteroid, failed, occultations.place(outline, across, chords), outline)
        )
    evidence = np.array(
        [
            np.log(a.weight) + logsumexp(p.log_likelihood) - np.log(len(p.log_likelihood))
            for a, _, p, _ in placed_outlines
        ]
    )
    posterior = np.exp(evidence - logsumexp(evidence))
    return [
        Outline(
            asteroid,
            failed,
            placed,
            outline,
            chords,
            float(weight),
            softmax(placed.log_likelihood),
            occultations.effective_number(placed.log_likelihood),
        )
        for (asteroid, failed, placed, outline), weight in zip(
            placed_outlines, posterior, strict=True
        )
    ]


def findings(outlines: Sequence[Outline]) -> list[Finding]:
    """Reasons not to trust what light curves and chords give together."""
    heavy = max(outlines, key=lambda o: o.posterior)
    if heavy.effective >= MIN_EFFECTIVE:
        return []
    values = {"effective": heavy.effective, "limit": MIN_EFFECTIVE, "bodies": len(heavy.joint)}
    return [Finding("chords-choose-few-bodies", values)]


def content(
    outlines: Sequence[Outline], events: Sequence[Occultation], file: str, seed: int
) -> dict[str, Any]:
    """The content of ``summary.json``; without ``diameter_km`` if the chords choose too few."""
    joint: BodyRow | None = None
    if not findings(outlines):
        parts = [o.diameters(seed, joint=True) for o in outlines]
        drawn = np.concatenate([d for d, _ in parts])
        weight = np.concatenate(
            [o.posterior * w for o, (_, w) in zip(outlines, parts, strict=True)]
        )
        joint = weighted_row(drawn, weight)
    return {
        "occultation": file,
        "events": [_event(e) for e in events],
        "solutions": [_solution(o, seed, joint is not None) for o in outlines],
        "diameter_km": joint,
        "notes": list(NOTES),
    }


NOTES = (
    "the direction and distance of the Earth from the asteroid are those of the occultation file "
    "(ecliptic J2000); aberration is neglected",
    "times of chords and of the light curve are taken to be on one scale; the body is rotated to "
    "the middle of each chord minus the light time",
    "places are on axes to the west and to the north of the equator of J2000",
    "diameters are those of the sphere with the volume of the convex body",
)


def _event(event: Occultation) -> dict[str, Any]:
    return {
        "jd": float(event.jd.mean()),
        "distance_km": float(np.linalg.norm(event.to_earth_km)),
        "n_chords": int(np.count_nonzero(~event.negative)),
        "n_negative": int(np.count_nonzero(event.negative)),
    }


def _solution(outline: Outline, seed: int, joint: bool) -> dict[str, Any]:
    spin = outline.asteroid.mean_spin
    smooth, limb = outline.inside(relief=False), outline.inside(relief=True)
    placed = outline.placed
    weight = outline.joint
    return {
        "pole_lon_deg": spin.pole_lon_deg,
        "pole_lat_deg": spin.pole_lat_deg,
        "weight_before": outline.asteroid.weight,
        "weight": outline.posterior if joint else None,
        "n_bodies": len(weight),
        "n_failed": outline.n_failed,
        "effective_bodies": outline.effective,
        "ends": len(limb),
        "ends_inside_90": int(limb.sum()),
        "share_inside_90": float(limb.mean()),
        "ends_inside_90_without_relief": int(smooth.sum()),
        "rms_distance_km": float(np.sqrt(np.mean(placed.distance**2))),
        "limb_relief": float(placed.relief.mean()),
        "log_evidence_chords": outline.log_evidence,
        "negative_chords_crossed": float((placed.depth > 0).mean(axis=0).sum()),
        "diameter_from_light_curves_km": outline.diameter(seed, joint=False),
        "diameter_km": outline.diameter(seed, joint=True) if joint else None,
        "rms_distance_joint_km": float(
            np.sqrt(np.sum(weight * np.mean(placed.distance**2, axis=1)))
        ),
    }


def weighted_row(drawn: Floats, weight: Floats) -> BodyRow:
    """Mean, sd and quantiles of weighted draws (S,)."""
    if np.allclose(weight, weight[0]):
        return row(drawn)
    share = weight / weight.sum()
    mean = float(np.sum(share * drawn))
    order = np.argsort(drawn)
    upto = np.cumsum(share[order]) - 0.5 * share[order]
    low, middle, high = np.interp((0.05, 0.5, 0.95), upto, drawn[order])
    sd = float(np.sqrt(np.sum(share * (drawn - mean) ** 2)))
    return {"mean": mean, "sd": sd, "q05": float(low), "q50": float(middle), "q95": float(high)}
