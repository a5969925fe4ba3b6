"""Test of an attitude law by measurements with equal geometry under the law.

Two measurements of a rigid body with the same directions to Sun and observer in the body's axes
have the same brightness. An attitude law identifies such measurements. If they differ by more than
the noise and the body's roughness allow, the law is wrong for any shape of the body.

The statistic is the mean over such pairs (i, j) of

    ln(1 + (fᵢ − fⱼ)² / (σᵢ² + σⱼ² + κ² f̄ᵢⱼ² dᵢⱼ²)),

where dᵢⱼ is the larger of the two angles between their directions, and κ is the body's roughness:
the relative change of brightness along a pass per radian of d, which occurs under any law. Pairs of
points in one pass that stay in each other's neighbourhood match under any law. They do not test the
law; they determine κ. The p-value is the rank of the statistic among those of random bodies
with the attitude of the law, observed at the same times with the same relative noise.

The brightness of a spinning body changes faster along a pass than any of these laws allows. κ is
then large and masks all differences. A law is therefore accepted only if the test has power, that
is, if brightness exchanged at random between points of similar phase angle would be rejected.

References
----------
Hall et al. 2007, sec. 4.4.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from lcbayes.core.errors import InputError
from lcbayes.core.progress import Silent
from lcbayes.core.reasons import Finding
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.separated import ensemble
from lcbayes.inversion.separated.reduced import Floats, Ints, Reduced, in_body, reduce, turns
from lcbayes.modelling.ephemeris import ephemeris
from lcbayes.physics.attitude.catalogue import by_unique_name
from lcbayes.physics.attitude.laws import Attitude

SEPARATION_DEG = 4.0  # largest separation of matching directions
PARTNERS = 6  # number of nearest partners used per point
MIN_PAIRS, MIN_POINTS = 60, 30
SAME_DEG = 0.5  # laws whose axes differ by a constant rotation within this are the same
ROUGHEST, SMOOTHEST = 30.0, 0.5  # 1/rad, limits of κ
EXCHANGES = 99  # of brightness between points, to estimate the power
MAX_ALLOWANCE = 0.3  # largest κ d of the median pair
ALIKE_PHASE = 20  # points among which brightness is exchanged
WINDOW, GLINT_SD, GLINT_RISE = 9, 6.0, 0.4  # points of the median window; thresholds


@dataclass(frozen=True)
class Pairs:
    """Pairs of measurements with matching directions under a law.

    Attributes
    ----------
    i, j : (P,) int
        Pairs that left each other's neighbourhood in between, or lie in different passes.
    d : (P,) rad
    near_i, near_j, near_d : the same for pairs within one neighbourhood, some steps apart
    """

    i: Ints
    j: Ints
    d: Floats
    near_i: Ints
    near_j: Ints
    near_d: Floats

    @property
    def n_points(self) -> int:
        """Number of measurements in the pairs."""
        return len(np.unique([self.i, self.j]))


@dataclass(frozen=True)
class Verdict:
    """Result of the test of a law.

    Attributes
    ----------
    name : of the law, with its settings if several were tested
    settings : of the law
    tested : bool
        Whether there were enough pairs. If not, ``reason`` states why, and the numbers are NaN.
    p_value : float
        Probability of a statistic at least as large if the law is correct.
    statistic, expected : float
        Value for the data, and the median over the random bodies.
    n_pairs, n_points : int
    powerless : bool
        Whether unrelated brightness would also pass; the law is then not tested.
    same_as : names of laws that these data cannot distinguish from this one
    """

    name: str
    settings: dict[str, object]
    tested: bool
    reason: str = ""
    p_value: float = np.nan
    statistic: float = np.nan
    expected: float = np.nan
    n_pairs: int = 0
    n_points: int = 0
    powerless: bool = False
    same_as: tuple[str, ...] = ()
    pairs: Pairs | None = field(default=None, repr=False)

    @property
    def sparse(self) -> bool:
        """Whether too few measurements match under the law."""
        too_few = self.n_pairs < MIN_PAIRS or self.n_points < MIN_POINTS
        return self.pairs is not None and too_few


@dataclass(frozen=True)
class AttitudeTest:
    """All laws, the most consistent first and the untested last.

    Attributes
    ----------
    verdicts : of every law
    level : probability below which a law is rejected
    n_glints : points left out as glints
    n_obs : points that remain
    seen : Reduced, without glints
    reasons : why no law could be tested; empty if any was
    """

    verdicts: tuple[Verdict, ...]
    level: float
    n_glints: int
    n_obs: int
    seen: Reduced
    reasons: list[Finding]

    def rejected(self, verdict: Verdict) -> bool:
        return verdict.tested and verdict.p_value < self.level


def attitude_test(
    curve: LightCurve,
    laws: Sequence[Attitude],
    *,
    level: float = 0.01,
    separation_deg: float = SEPARATION_DEG,
    n_bodies: int = 499,
    seed: int = 0,
    progress: Silent | None = None,
) -> AttitudeTest:
    """Test every law by pairs of measurements with matching geometry under the law.

    Parameters
    ----------
    curve : LightCurve
        With errors, and the geometry required by the laws.
    laws : the hypotheses, for instance from `physics.catalogue`
    level : a law is rejected below this p-value, which must be above 1/(1 + n_bodies)
    separation_deg : largest angle between matching directions
    n_bodies : number of random bodies for each null distribution

    Raises
    ------
    InputError
        The curve has no errors, an option is out of range, or no p-value can be below the level.
    """
    if not 0.0 < separation_deg <= 30.0:
        raise InputError(f"separation_deg is {separation_deg:g}; expected 0 < angle <= 30 degrees")
    if not 0.0 < level < 1.0 or n_bodies < 19:
        raise InputError("level must lie in 0 .. 1, and n_bodies be 19 or more")
    if not _smallest(n_bodies) < level:
        raise InputError(
            f"no p-value among {n_bodies} bodies is below {_smallest(n_bodies):.2g}, so that no "
            f"law can be rejected at the level {level:g}; give --bodies {2 * int(1 / level) - 1} "
            "or more"
        )
    progress = progress or Silent()
    seen = reduce(curve)
    glint = glints(seen)
    seen = seen.at(np.flatnonzero(~glint))
    eph = ephemeris(curve)
    verdicts: list[Verdict] = []
    axes: dict[str, Floats] = {}
    named = by_unique_name(laws)
    with progress.stage("testing laws", len(named), "laws") as track:
        for name, law in named.items():
            try:
                parts = turns(law, eph, seen)
            except InputError as fault:
                reason = str(fault).removeprefix(f"the law {law.name!r} ")
                verdicts.append(Verdict(name, law.settings(), False, reason))
                track.advance(1, name)
                continue
            axes[name] = np.stack(parts, axis=1)
            verdict = _test(law, parts, seen, np.deg2rad(separation_deg), n_bodies, level, seed)
            verdicts.append(replace(verdict, name=name))
            track.advance(1, name)
    tested = [v for v in verdicts if v.tested]
    verdicts = [_with_same(v, axes) for v in verdicts]
    verdicts.sort(key=lambda v: (not v.tested, -v.p_value if v.tested else 0.0, v.statistic))
    reasons = [] if tested else _untested(verdicts, separation_deg)
    return AttitudeTest(tuple(verdicts), level, int(glint.sum()), len(seen.t), seen, reasons)


def _untested(verdicts: Sequence[Verdict], separation_deg: float) -> list[Finding]:
    """Findings why no law could be tested, the most frequent first."""
    pairs = {"pairs": MIN_PAIRS, "points": MIN_POINTS, "separation_deg": separation_deg}
    each = Counter(
        ("too-few-pairs", "")
        if v.sparse
        else ("no-power", "")
        if v.powerless
        else ("law-not-applicable", v.reason)
        for v in verdicts
    )
    return [
        Finding(code, {"count": n, "laws": len(verdicts), "why": why, **pairs})
        for (code, why), n in each.most_common()
    ]


def _smallest(n_null: int) -> float:
    """Smallest p-value of a rank among ``n_null`` simulations."""
    return 1.0 / (1 + n_null)


def glints(seen: Reduced) -> NDArray[np.bool_]:
    """Glint points: narrow flashes within a pass that are not repeated in other measurements.

    A glint exceeds the median of `WINDOW` neighbours in the pass by `GLINT_SD` robust standard
    deviations (of such differences, or of the errors if larger) and by a fraction `GLINT_RISE` of
    that median.
    """
    out = np.zeros(len(seen.t), bool)
    for p in range(int(seen.one_pass.max()) + 1):
        here = np.flatnonzero(seen.one_pass == p)
        if len(here) < WINDOW:
            continue
        flux = seen.flux[here]
        padded = np.pad(flux, WINDOW // 2, mode="reflect")
        middle = np.median(np.lib.stride_tricks.sliding_window_view(padded, WINDOW), axis=1)
        rise = flux - middle
        spread = np.maximum(1.4826 * np.median(np.abs(rise)), seen.error[here])
        out[here] = (rise > GLINT_SD * spread) & (rise > GLINT_RISE * np.abs(middle))
    return out


def _with_same(verdict: Verdict, axes: dict[str, Floats]) -> Verdict:
    """Note the laws whose axes differ from this one's by a constant rotation, to `SAME_DEG`."""
    mine = axes.get(verdict.name)
    if mine is None:
        return verdict
    same = []
    for name, other in axes.items():
        if name == verdict.name or other.shape != mine.shape:
            continue
        between = np.swapaxes(mine, 2, 3) @ other
        change = np.swapaxes(between[:1], 2, 3) @ between
        angle = np.arccos(np.clip(0.5 * (np.trace(change, axis1=2, axis2=3) - 1.0), -1.0, 1.0))
        if np.degrees(angle.max()) < SAME_DEG:
            same.append(name)
    return replace(verdict, same_as=tuple(same))


def _test(
    law: Attitude,
    axes: Sequence[Floats],
    seen: Reduced,
    reach: float,
    n_bodies: int,
    level: float,
    seed: int,
) -> Verdict:
    """Test one law."""
    parts = in_body(axes, seen)
    pairs = alike(parts, seen, reach)
    if len(pairs.i) < MIN_PAIRS or pairs.n_points < MIN_POINTS:
        return Verdict(
            law.name,
            law.settings(),
            False,
            f"{len(pairs.i)} pairs among {pairs.n_points} points are alike; "
            f"{MIN_PAIRS} pairs among {MIN_POINTS} points are needed",
            n_pairs=len(pairs.i),
            n_points=pairs.n_points,
            pairs=pairs,
        )
    rng = np.random.default_rng(seed)
    bodies = ensemble.draw(n_bodies, rng, articulated=len(parts) > 1)
    flux = ensemble.fluxes(bodies, *parts[0], parts[1] if len(parts) > 1 else None)
    mean = flux.mean(axis=1)
    usable = mean > 0
    if not _smallest(int(np.sum(usable))) < level:
        return Verdict(
            law.name,
            law.settings(),
            False,
            f"only {np.sum(usable)} of {n_bodies} bodies are lit and seen; give more --bodies",
            n_pairs=len(pairs.i),
            n_points=pairs.n_points,
            pairs=pairs,
        )
    flux = flux[usable] * (seen.flux.mean() / mean[usable])[:, None]
    flux = flux + seen.error * rng.standard_normal(flux.shape)
    null = statistic(flux, seen.error, pairs)
    mine = float(statistic(seen.flux[None], seen.error, pairs)[0])
    p = (1 + np.sum(null >= mine)) / (1 + len(null))
    powerless = bool(p >= level) and not _has_power(seen, pairs, null, level, rng)
    return Verdict(
        law.name,
        law.settings(),
        not powerless,
        _without_power(seen, pairs) if powerless else "",
        np.nan if powerless else float(p),
        mine,
        float(np.median(null)),
        len(pairs.i),
        pairs.n_points,
        powerless,
        pairs=pairs,
    )


def _has_power(
    seen: Reduced, pairs: Pairs, null: Floats, level: float, rng: np.random.Generator
) -> bool:
    """Whether brightness that depends only on the phase angle would be rejected at the level.

    Flux and error of the paired points are exchanged at random among `ALIKE_PHASE` points of the
    same group with successive phase angles, which are the same under every law. The roughness
    remains as observed. More than half of the exchanges must be rejected. There is no power if the
    roughness allows pairs to differ by more than `MAX_ALLOWANCE` of their flux.
    """
    phase = np.einsum("ti,ti->t", seen.sun, seen.obs)
    kappa = roughness(seen.flux[None], seen.error, pairs)
    if kappa[0] * np.median(pairs.d) > MAX_ALLOWANCE:
        return False
    critical = np.quantile(null, 1.0 - level)
    points = np.unique([pairs.i, pairs.j])
    above = 0
    for _ in range(EXCHANGES):
        order = np.arange(len(seen.t))
        for g in np.unique(seen.group[points]):
            here = points[seen.group[points] == g]
            here = here[np.argsort(phase[here])]
            for part in np.array_split(here, max(1, len(here) // ALIKE_PHASE)):
                order[part] = rng.permutation(part)
        other = seen.at(order)
        above += float(distance(other.flux[None], other.error, pairs, kappa)[0]) > critical
    return above > EXCHANGES / 2


def _without_power(seen: Reduced, pairs: Pairs) -> str:
    """Reason why the pairs cannot reject a law."""
    i, j = pairs.i, pairs.j
    mean = 0.5 * (seen.flux[i] + seen.flux[j])
    differ = float(np.median(np.abs(seen.flux[i] - seen.flux[j]) / np.abs(mean)))
    noise = float(np.median(np.hypot(seen.error[i], seen.error[j]) / np.abs(mean)))
    return (
        f"no power: pairs differ by {100 * differ:.0f} % (median; noise {100 * noise:.0f} %), but "
        "brightness changes so fast along passes that unrelated brightness would pass as well: the "
        "body may spin"
    )


def alike(parts: Sequence[tuple[Floats, Floats]], seen: Reduced, reach: float) -> Pairs:
    """Pairs whose directions to Sun and observer agree within ``reach`` (rad) in every part."""
    place = np.concatenate([v for part in parts for v in part], axis=1)  # (T, 6 F), unit vectors
    # If each of the 2F angles is within reach, the total chord is at most sqrt(2F) times reach.
    chord = 2.0 * np.sin(0.5 * reach)
    raw = KDTree(place).query_pairs(chord * np.sqrt(place.shape[1] / 3), output_type="ndarray")
    i, j = (np.sort(raw, axis=1).T if len(raw) else np.zeros((2, 0), int)).astype(np.int64)
    apart = np.linalg.norm((place[i] - place[j]).reshape(len(i), place.shape[1] // 3, 3), axis=2)
    d = 2.0 * np.arcsin(np.clip(0.5 * apart.max(axis=1, initial=0.0), 0.0, 1.0))
    kept = (d <= reach) & (seen.group[i] == seen.group[j])
    i, j, d = i[kept], j[kept], d[kept]
    follow = (seen.one_pass[i] == seen.one_pass[j]) & (j <= _run_end(place, seen, chord)[i])
    near = follow & (d >= 0.2 * reach)  # closer pairs contain only noise
    i2, j2, d2 = _nearest(i[~follow], j[~follow], d[~follow])
    pick = np.flatnonzero(near)
    pick = pick[:: max(1, len(pick) // 4000)]
    return Pairs(i2, j2, d2, i[pick], j[pick], d[pick])


def _run_end(place: Floats, seen: Reduced, chord: float) -> Ints:
    """For each point, the last point of its pass before directions change by over 2 reaches."""
    n = len(place)
    end = np.arange(n)
    last = np.searchsorted(seen.one_pass, seen.one_pass, side="right") - 1
    going = np.ones(n, bool)
    for step in range(1, n):
        rows = np.flatnonzero(going & (end + 1 <= last) & (end == np.arange(n) + step - 1))
        if not len(rows):
            break
        apart = np.linalg.norm((place[rows] - place[rows + step]).reshape(len(rows), -1, 3), axis=2)
        stays = apart.max(axis=1) <= 2.0 * chord
        end[rows[stays]] += 1
        going[rows[~stays]] = False
    return end


def _nearest(i: Ints, j: Ints, d: Floats) -> tuple[Ints, Ints, Floats]:
    """The nearest partners of every point, with each pair listed once."""
    both = np.concatenate([i, j]), np.tile(np.arange(len(i)), 2)
    order = np.lexsort((d[both[1]], both[0]))
    point, pair = both[0][order], both[1][order]
    first = np.searchsorted(point, point, side="left")
    kept = np.unique(pair[np.arange(len(point)) - first < PARTNERS])
    return i[kept], j[kept], d[kept]


def statistic(flux: Floats, error: Floats, pairs: Pairs) -> Floats:
    """The statistic of the module docstring for several light curves at once, (B, T) → (B,)."""
    return distance(flux, error, pairs, roughness(flux, error, pairs))


def distance(flux: Floats, error: Floats, pairs: Pairs, kappa: Floats) -> Floats:
    """The statistic for given roughness κ (B,)."""
    i, j = pairs.i, pairs.j
    mean = 0.5 * (flux[:, i] + flux[:, j])
    own = error[i] ** 2 + error[j] ** 2 + (kappa[:, None] * mean * pairs.d) ** 2
    return np.mean(np.log1p((flux[:, i] - flux[:, j]) ** 2 / own), axis=1)


def roughness(flux: Floats, error: Floats, pairs: Pairs) -> Floats:
    """κ (B,): rms relative change per radian along passes, with the noise subtracted."""
    i, j, d = pairs.near_i, pairs.near_j, pairs.near_d
    if len(i) < 20:
        return np.full(len(flux), 3.0)
    mean = 0.5 * (flux[:, i] + flux[:, j])
    change = (flux[:, i] - flux[:, j]) ** 2 - error[i] ** 2 - error[j] ** 2
    kappa2 = change.mean(axis=1) / np.maximum(np.mean((mean * d) ** 2, axis=1), 1e-300)
    return np.sqrt(np.clip(kappa2, SMOOTHEST**2, ROUGHEST**2))
