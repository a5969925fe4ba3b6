"""Pole and sidereal period of a spinning object from the periodicity of its light curve only."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from lcbayes.core.progress import Silent
from lcbayes.core.reasons import Finding
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.spin import periods
from lcbayes.inversion.spin.detrended import Pass, split
from lcbayes.inversion.spin.mean_frequency import MeanFrequency, mean_frequency
from lcbayes.inversion.spin.pole import MULTIPLES, Sky, posterior
from lcbayes.inversion.spin.windows import MIN_CYCLES, Phases, Synodic, phases, synodic

Floats = NDArray[np.float64]

ALARM = 0.01  # nominal false-alarm rate of periodicity, and of a synodic-sidereal difference
MIN_SKILL = 0.2  # least skill of predicting a segment from its neighbours
MAX_OTHER = 0.1  # largest fraction of variance in a line that is not a harmonic
MIN_FIT = 1e-3  # probability of chi2 below which no pole explains the phases
MAX_AREA = 0.15  # of the sky in the 90 % region
MIN_PASSES = 3  # with steady harmonics; with fewer, shape effects can mimic a pole
MIN_MULTIPLE = 0.75  # probability of the most probable number of cycles per turn
MAX_POLES = 4  # separate solutions: a pole and its mirror for each sense of rotation
REPEATS, STABLE, RAPID, MEASURABLE = "periodic", "stable", "rapid", "measurable"
UNIQUE = "unique"
TOO_WIDE = "pole-undetermined"  # code of a reason


@dataclass(frozen=True)
class Condition:
    """A condition for the validity of the method, and the finding if it is not met."""

    name: str
    met: bool
    finding: Finding


@dataclass(frozen=True)
class Solution:
    """A connected part of the 90 % region.

    Attributes
    ----------
    pole : (3,)
        Unit vector in the axes of the light curve; the body rotates about it right-handed.
    radius : rad
        Root mean square angle from the pole.
    frequency, error : Hz
        Sidereal frequency and its standard deviation.
    multiple : cycles of the base period per turn
    weight : of the posterior
    """

    pole: Floats
    radius: float
    frequency: float
    error: float
    multiple: int
    weight: float


@dataclass
class Spin:
    """Result of `estimate`.

    Attributes
    ----------
    passes : those with enough points
    grid, power : (F,)
        Frequencies (Hz) and the fraction of χ² explained by a sinusoid.
    false_alarm : probability that noise has a peak at least as high
        The larger of the values from shuffled points and, if errors are known, from the errors.
    base : Hz or None
        Mean frequency of the modulation; None if no stable modulation is detected.
    harmonics : of the base, as fitted
    skill : fraction of the variance that neighbouring segments predict
    mean : frequency of the longest pass, its error and drift, or None
    windows : synodic frequencies in sliding windows, or None
    phases, sky : or None
    conditions : in the order of the tests
    solutions : heaviest first; empty if a condition other than "unique" fails
    notes : further remarks on the result
    """

    passes: list[Pass]
    grid: Floats
    power: Floats
    false_alarm: float
    base: float | None = None
    harmonics: list[int] = field(default_factory=list)
    skill: float | None = None
    mean: MeanFrequency | None = None
    windows: Synodic | None = None
    phases: Phases | None = None
    sky: Sky | None = None
    conditions: list[Condition] = field(default_factory=list)
    solutions: list[Solution] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @property
    def reasons(self) -> list[Finding]:
        """Findings against pole and period; empty if there are none."""
        return [c.finding for c in self.conditions if not c.met]

    @property
    def too_wide(self) -> list[Solution]:
        """Parts of the 90 % region, if its area is the only reason against a pole."""
        if self.sky is None or [finding.code for finding in self.reasons] != [TOO_WIDE]:
            return []
        return solutions(self.sky)

    def require(self, name: str, met: bool, code: str, **values: Any) -> bool:
        """Record a condition and whether it is met, with the code of the reason if it is not."""
        met = bool(met)
        self.conditions.append(Condition(name, met, Finding(code, values)))
        return met


def estimate(
    curve: LightCurve, *, n_shuffles: int = 199, seed: int = 0, progress: Silent | None = None
) -> Spin:
    """Sidereal period and pole from the variation of the synodic period along passes.

    The method does not require a shape. The strongest line of a periodogram gives the base period.
    The phases of its harmonics in windows along each pass are compared with the predictions for
    every pole (`pole.posterior`). Passes need not be linked in phase.

    The method is valid under three conditions (Hall et al. 2007, sec. 4.1): the spin is stable, it
    is rapid enough to be measured in single passes, and the synodic period differs measurably from
    the sidereal period. If a condition fails, `reasons` names it and there are no solutions. If the
    number of cycles per turn is ambiguous, or more than four poles remain, the solutions are listed
    only as candidates, and `reasons` states this.

    Parameters
    ----------
    curve : LightCurve
    n_shuffles : int
        Number of shuffles in the test for periodicity; at least 99 for its level of 1 %.
    seed : int
        For the shuffles.

    Returns
    -------
    Spin

    Raises
    ------
    InputError
        No pass has enough points.
    """
    progress = progress or Silent()
    result = periodicity(
        split(curve), curve.error is not None, n_shuffles=n_shuffles, seed=seed, progress=progress
    )
    with progress.stage("pole", 1, "fit") as track:
        if result.base is not None and _followed(result):
            _solve_pole(result)
        track.advance(1)
    return result


def periodicity(
    passes: list[Pass], known_errors: bool, *, n_shuffles: int, seed: int, progress: Silent
) -> Spin:
    """Periodogram, false-alarm probability, and the base period if its conditions hold.

    Parameters
    ----------
    passes : list of Pass
    known_errors : bool
        Whether the errors come with the data; if so, they limit the false-alarm probability too.
    n_shuffles, seed : as for `estimate`
    progress : Silent

    Returns
    -------
    Spin
        Without phases, pole and solutions.
    """
    grid = periods.frequencies(passes)
    with progress.stage("periodogram", 2, "steps") as track:
        power = periods.power(passes, grid)
        track.advance(1)
        noise = periods.shuffled_peaks(passes, grid, np.random.default_rng(seed), n_shuffles)
        track.advance(1)
    alarm = (1 + int(np.sum(noise >= power.max()))) / (1 + n_shuffles)
    if known_errors:
        alarm = max(alarm, periods.chance(passes, grid, power))
    result = Spin(passes, grid, power, alarm)
    highest = max(one.nyquist for one in passes)
    if grid[-1] < 0.999 * highest:
        result.notes.append(
            f"periods below {1.0 / grid[-1]:.3g} s (sampled to {1.0 / highest:.3g} s) were not "
            "looked for; for those give a part of the longest pass"
        )
    _periodic(result)
    return result


def _periodic(result: Spin) -> bool:
    """Whether the brightness has one sufficiently short period; sets base and harmonics."""
    passes, grid = result.passes, result.grid
    alarm = result.false_alarm
    if not result.require(REPEATS, alarm <= ALARM, "no-period", false_alarm=alarm, level=ALARM):
        return False
    line = float(grid[np.argmax(result.power)])
    base, harmonics = periods.base(passes, periods.refine(passes, line, [1]))
    base = periods.refine(passes, base, harmonics)
    longest = max(one.length for one in passes)
    while longest * base >= MIN_CYCLES:
        other, part = periods.other_line(passes, grid, base, harmonics)
        multiple = periods.subharmonic(base, other, 1.0 / longest) if part > MAX_OTHER else 0
        if not multiple:
            break
        base, harmonics = base / multiple, list(range(1, multiple * max(harmonics) + 1))
        base = periods.refine(passes, base, harmonics)
    cycles = longest * base
    if not result.require(
        RAPID,
        cycles >= MIN_CYCLES,
        "too-few-cycles",
        cycles=cycles,
        period_s=1.0 / base,
        least=MIN_CYCLES,
    ):
        return False
    result.skill = periods.skill(passes, base, harmonics)
    if not result.require(
        STABLE,
        result.skill >= MIN_SKILL,
        "not-repeating",
        period_s=1.0 / base,
        percent=100 * max(result.skill, 0.0),
        least=100 * MIN_SKILL,
    ):
        return False
    if not result.require(
        STABLE,
        part <= MAX_OTHER,
        "second-period",
        other_s=1.0 / other,
        period_s=1.0 / base,
        percent=100 * part,
    ):
        return False
    result.base, result.harmonics = base, harmonics
    return True


def _followed(result: Spin) -> bool:
    """Whether the period can be followed along passes, and changes with the geometry."""
    base, passes = result.base, result.passes
    assert base is not None
    result.mean = mean_frequency(max(passes, key=lambda p: p.length), base, result.harmonics)
    seen = phases(passes, base, result.harmonics)
    result.phases = seen
    if not result.require(RAPID, seen is not None, "unsteady-harmonics"):
        return False
    assert seen is not None
    result.windows = synodic(passes, base, result.harmonics)
    same = periods.constant(seen.phase, seen.error, np.column_stack([seen.t, seen.constants]))
    return result.require(MEASURABLE, same <= ALARM, "constant-synodic-period", p_value=same)


def _solve_pole(result: Spin) -> None:
    """Pole and sidereal period, and whether they are determined."""
    assert result.phases is not None
    result.sky = sky = posterior(result.phases)
    fit = float(stats.chi2.sf(sky.chi2, max(sky.freedom, 1)))
    stable = result.require(
        STABLE, fit >= MIN_FIT, "no-constant-spin", chi2=sky.chi2, dof=sky.freedom
    )
    count = len(np.unique(result.phases.which))
    several = result.require(
        MEASURABLE, count >= MIN_PASSES, "too-few-passes", count=count, least=MIN_PASSES
    )
    measured = result.require(
        MEASURABLE,
        sky.area <= MAX_AREA,
        TOO_WIDE,
        percent=100 * sky.area,
        most=100 * MAX_AREA,
    )
    if not (stable and several and measured):
        return
    result.solutions = poles = solutions(sky)
    likeliest = float(sky.weight.sum(axis=0).max())
    turn = [1.0 / s.frequency for s in poles]
    result.require(
        UNIQUE,
        likeliest >= MIN_MULTIPLE,
        "ambiguous-period",
        shortest_s=min(turn),
        longest_s=max(turn),
        probability=likeliest,
        least=MIN_MULTIPLE,
    )
    result.require(UNIQUE, len(poles) <= MAX_POLES, "many-poles", count=len(poles), most=MAX_POLES)


def solutions(sky: Sky, probability: float = 0.9) -> list[Solution]:
    """The connected parts of the smallest region of pole and multiple, heaviest first."""
    flat = sky.weight.ravel()
    order = np.argsort(-flat)
    count = int(np.searchsorted(np.cumsum(flat[order]), probability)) + 1
    chosen = np.zeros(flat.size, bool)
    chosen[order[:count]] = True
    chosen = chosen.reshape(sky.weight.shape)
    reach = 2.2 * np.sqrt(sky.cell)
    poles = []
    for j, multiple in enumerate(MULTIPLES):
        at = np.flatnonzero(chosen[:, j])
        if at.size == 0:
            continue
        pairs = KDTree(sky.poles[at]).query_pairs(reach, output_type="ndarray")
        links = coo_matrix((np.ones(len(pairs)), pairs.T), shape=(at.size, at.size))
        n_parts, label = connected_components(links, directed=False)
        for part in range(n_parts):
            rows = at[label == part]
            w = sky.weight[rows, j]
            total = float(w.sum())
            middle = w @ sky.poles[rows]
            pole = middle / np.linalg.norm(middle)
            apart = np.arccos(np.clip(sky.poles[rows] @ pole, -1.0, 1.0))
            f = float(w @ sky.frequency[rows, j] / total)
            second = w @ (sky.error[rows, j] ** 2 + sky.frequency[rows, j] ** 2) / total
            poles.append(
                Solution(
                    pole,
                    float(np.sqrt(w @ apart**2 / total + sky.cell / (2 * np.pi))),
                    f,
                    float(np.sqrt(max(second - f**2, 0.0))),
                    multiple,
                    total,
                )
            )
    return sorted(poles, key=lambda s: -s.weight)
