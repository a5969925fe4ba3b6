"""Pole and sidereal period of a spinning object from the periodicity of its light curve alone."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from lcbayes.core.progress import Silent
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.spin import periods
from lcbayes.inversion.spin.detrended import Pass, split
from lcbayes.inversion.spin.pole import MULTIPLES, Sky, posterior
from lcbayes.inversion.spin.windows import MIN_CYCLES, Phases, Synodic, phases, synodic

Floats = NDArray[np.float64]

ALARM = 0.01  # nominal rate of false alarms of periodicity, and of a measured difference
MIN_SKILL = 0.2  # of a stretch foretold by its neighbours
MAX_OTHER = 0.1  # of the variance in a line that is no harmonic
MIN_FIT = 1e-3  # probability of chi2 below which no pole explains the phases
MAX_AREA = 0.15  # of the sky in the 90 % region
REPEATS, STABLE, RAPID, MEASURABLE = "periodic", "stable", "rapid", "measurable"


@dataclass(frozen=True)
class Condition:
    """One of the conditions under which the method holds, and why it fails where it does."""

    name: str
    met: bool
    words: str


@dataclass(frozen=True)
class Solution:
    """A connected part of the 90 % region.

    Attributes
    ----------
    pole : (3,)
        Unit vector, axes of the light curve; the body turns about it right-handed.
    radius : rad
        Root mean square angle from it.
    frequency, error : Hz
        Sidereal, with its standard deviation.
    multiple : cycles of the base period per turn
    weight : of the posterior
    """

    pole: Floats
    radius: float
    frequency: float
    error: float
    multiple: int
    weight: float


@dataclass(frozen=True)
class Spin:
    """What `estimate` finds.

    Attributes
    ----------
    passes : those with enough points
    grid, power : (F,)
        Frequencies (Hz) and the part of χ² that a sinusoid explains.
    false_alarm : probability that noise has as high a peak
        Of the points in random order and, where errors are known, of these: the larger.
    base : Hz or None
        Mean frequency of the modulation; None where a pass shows none that is stable.
    harmonics : of the base, as fitted
    skill : part of the variance that neighbouring stretches foretell
    folded : (frequency, error) Hz of the longest pass by epoch folding, or None
    windows : synodic frequencies in sliding windows, or None
    phases, sky : or None
    conditions : in the order in which they are asked
    solutions : heaviest first; empty where a condition fails
    notes : what else a reader should know
    """

    passes: list[Pass]
    grid: Floats
    power: Floats
    false_alarm: float
    base: float | None = None
    harmonics: list[int] = field(default_factory=list)
    skill: float | None = None
    folded: tuple[float, float] | None = None
    windows: Synodic | None = None
    phases: Phases | None = None
    sky: Sky | None = None
    conditions: list[Condition] = field(default_factory=list)
    solutions: list[Solution] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @property
    def reasons(self) -> list[str]:
        """Why there is no pole, in words; empty where there is one."""
        return [c.words for c in self.conditions if not c.met]


def estimate(
    curve: LightCurve, *, n_shuffles: int = 199, seed: int = 0, progress: Silent | None = None
) -> Spin:
    """Sidereal period and pole from how the synodic period varies along passes.

    No shape enters. The strongest line of a periodogram gives the base period; the phases of its
    harmonics in windows along each pass are compared with what every pole would make of them
    (`pole.posterior`). Passes need not be linked in phase.

    The method holds under three conditions (Hall et al. 2007, sec. 4.1): the spin is stable, it is
    rapid enough to be measured in single passes, and the synodic period differs measurably from
    the sidereal one. Where one fails, `reasons` says so and there are no solutions.

    Parameters
    ----------
    curve : LightCurve
    n_shuffles : int
        Of the test for periodicity, at least 99 to reach its 1 %.
    seed : int
        Of the shuffles.

    Returns
    -------
    Spin

    Raises
    ------
    InputError
        No pass has enough points.
    """
    progress = progress or Silent()
    passes = split(curve)
    grid = periods.frequencies(passes)
    with progress.stage("periodogram", 2, "steps") as track:
        power = periods.power(passes, grid)
        track.advance(1)
        noise = periods.shuffled_peaks(passes, grid, np.random.default_rng(seed), n_shuffles)
        track.advance(1)
    alarm = (1 + int(np.sum(noise >= power.max()))) / (1 + n_shuffles)
    if curve.error is not None:
        alarm = max(alarm, periods.chance(passes, grid, power))
    found: dict[str, Any] = {
        "passes": passes,
        "grid": grid,
        "power": power,
        "false_alarm": alarm,
    }
    conditions: list[Condition] = []
    found["conditions"] = conditions
    highest = max(one.nyquist for one in passes)
    if grid[-1] < 0.999 * highest:
        found["notes"] = [
            f"periods below {1.0 / grid[-1]:.3g} s (sampled to {1.0 / highest:.3g} s) were not "
            "looked for; for those give a part of the longest pass"
        ]
    with progress.stage("pole", 1, "fit") as track:
        _explain(found, conditions)
        track.advance(1)
    result = Spin(**found)
    return replace(result, solutions=[]) if result.reasons else result


def _explain(found: dict[str, Any], conditions: list[Condition]) -> None:
    """Fill in what can be said, and stop at the first condition without which nothing can."""

    def ask(name: str, met: bool, yes: str, no: str) -> bool:
        conditions.append(Condition(name, bool(met), yes if met else no))
        return bool(met)

    passes, grid = found["passes"], found["grid"]
    line = float(grid[np.argmax(found["power"])])
    if not ask(
        REPEATS,
        found["false_alarm"] <= ALARM,
        f"a period is seen (false-alarm probability {found['false_alarm']:.2g})",
        f"no period is seen: noise has a peak as high with probability "
        f"{found['false_alarm']:.2g}, and {ALARM:g} is asked for",
    ):
        return
    base, harmonics = periods.base(passes, periods.refine(passes, line, [1]))
    base = periods.refine(passes, base, harmonics)
    found["skill"] = periods.skill(passes, base, harmonics)
    longest = max(passes, key=lambda p: p.length)
    cycles = longest.length * base
    if not ask(
        RAPID,
        cycles >= MIN_CYCLES,
        f"the longest pass has {cycles:.1f} cycles",
        f"the spin is not rapid enough: the longest pass holds {cycles:.1f} cycles of the "
        f"strongest period, {1 / base:.4g} s, and {MIN_CYCLES:g} are needed to measure it within a "
        "pass",
    ):
        return
    if not ask(
        STABLE,
        found["skill"] >= MIN_SKILL,
        f"a stretch foretells {100 * found['skill']:.0f} % of the variance of the next",
        f"the brightness does not repeat steadily: with {1 / base:.4g} s a stretch foretells "
        f"{100 * max(found['skill'], 0.0):.0f} % of the variance of the next, and "
        f"{100 * MIN_SKILL:.0f} % are asked for",
    ):
        return
    other, part = periods.other_line(passes, grid, base, harmonics)
    if not ask(
        STABLE,
        part <= MAX_OTHER,
        "no second period",
        f"the spin is not stable: a line at {1 / other:.4g} s, no harmonic of {1 / base:.4g} s, "
        f"has {100 * part:.0f} % of the variance, as when a body tumbles",
    ):
        return
    seen = phases(passes, base, harmonics)
    found["phases"] = seen
    if not ask(
        RAPID,
        seen is not None,
        "harmonics are steady and strong enough",
        "no harmonic keeps an amplitude of five times its error all along a pass, so the period "
        "cannot be followed within one",
    ):
        return
    assert seen is not None
    found["base"], found["harmonics"] = base, harmonics
    found["folded"] = periods.fold(longest, base)
    found["windows"] = synodic(passes, base, harmonics)
    same = periods.constant(seen.phase, seen.error, np.column_stack([seen.t, seen.constants]))
    measured = ask(
        MEASURABLE,
        same <= ALARM,
        f"the synodic period varies (p = {same:.1g} for a constant one)",
        f"the synodic period does not measurably differ from the sidereal one: one constant "
        f"period explains all passes (p = {same:.2g})",
    )
    if not measured:
        return
    sky = posterior(seen)
    found["sky"] = sky
    fit = float(stats.chi2.sf(sky.chi2, max(sky.freedom, 1)))
    ask(
        STABLE,
        fit >= MIN_FIT,
        f"a pole explains the phases (chi2 {sky.chi2:.1f} for {sky.freedom} degrees of freedom)",
        f"no constant spin explains the phases: chi2 is {sky.chi2:.0f} for {sky.freedom} degrees "
        "of freedom; the spin changes, or the axis moves",
    )
    ask(
        MEASURABLE,
        sky.area <= MAX_AREA,
        f"the pole lies within {100 * sky.area:.2g} % of the sky",
        f"the difference between synodic and sidereal period leaves the pole open: its 90 % region "
        f"is {100 * sky.area:.0f} % of the sky, and {100 * MAX_AREA:.0f} % are the most that is "
        "given; add passes of other geometry",
    )
    found["solutions"] = solutions(sky)


def solutions(sky: Sky, probability: float = 0.9) -> list[Solution]:
    """The connected parts of the smallest region of pole and multiple, heaviest first."""
    flat = sky.weight.ravel()
    order = np.argsort(-flat)
    count = int(np.searchsorted(np.cumsum(flat[order]), probability)) + 1
    chosen = np.zeros(flat.size, bool)
    chosen[order[:count]] = True
    chosen = chosen.reshape(sky.weight.shape)
    reach = 2.2 * np.sqrt(sky.cell)
    found = []
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
            found.append(
                Solution(
                    pole,
                    float(np.sqrt(w @ apart**2 / total + sky.cell / (2 * np.pi))),
                    f,
                    float(np.sqrt(max(second - f**2, 0.0))),
                    multiple,
                    total,
                )
            )
    return sorted(found, key=lambda s: -s.weight)
