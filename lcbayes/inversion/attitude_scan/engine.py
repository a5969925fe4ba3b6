"""The complete scan, from a light curve to its solutions."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.checkpoint import Checkpoint
from lcbayes.core.cluster import Run, worker_pool
from lcbayes.core.constants import HOUR_S
from lcbayes.core.errors import InputError
from lcbayes.core.progress import Silent, Track
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.albedo_area.kernel import Material
from lcbayes.inversion.albedo_area.observed import linear_flux
from lcbayes.inversion.attitude_scan import nights, search, sparse, stabilised
from lcbayes.inversion.attitude_scan.contradiction import compared
from lcbayes.inversion.attitude_scan.faceted import polish
from lcbayes.inversion.attitude_scan.grid import Grid, grid
from lcbayes.inversion.attitude_scan.harmonics import SparsePoints
from lcbayes.inversion.attitude_scan.points import Points
from lcbayes.inversion.attitude_scan.result import AttitudeScan, Solution, Table
from lcbayes.inversion.attitude_scan.smooth import SmoothBody
from lcbayes.inversion.attitude_scan.solutions import Geometry, counted, distinct
from lcbayes.inversion.attitude_scan.spin import Ends, in_convention
from lcbayes.modelling.epochs import Epochs
from lcbayes.physics.attitude.laws import Spinning
from lcbayes.physics.bodies import facets
from lcbayes.physics.brightness import DIFFUSE_LAWS

Floats = NDArray[np.float64]

COARSE_FACETS, COARSE_DEGREE = 150, 4  # of the body used for screening
SMOOTH_LAW = "lommel-seeliger-lambert"  # bodies with regolith, without edges
FROM_MAP = 3  # poles of the sky map that are also refined


@dataclass(frozen=True)
class Settings:
    """Settings of a scan; see `lcbayes.scan`."""

    period_h: float | None
    period_range_h: tuple[float, float] | None
    laws: tuple[str, ...]
    reflectance: str
    n_poles: int
    period_step: float
    n_facets: int
    degree: int
    keep: int
    n_sky: int
    common_noise: bool
    sparse: bool = False

    def as_dict(self) -> dict[str, Any]:
        """Settings by name; sequences in command-line form."""
        joined = {
            k: ",".join(map(str, v)) if isinstance(v, tuple) else v for k, v in asdict(self).items()
        }
        return {k: v for k, v in joined.items() if v not in (None, "")}

    @property
    def smooth(self) -> bool:
        """Whether solutions are bodies without edges."""
        return self.reflectance == SMOOTH_LAW


def run(
    curve: LightCurve,
    settings: Settings,
    scheduler: str | None,
    n_workers: int | None,
    checkpoint: Checkpoint,
    progress: Silent,
    further: nights.Further | None = None,
) -> AttitudeScan:
    """Screen every hypothesis, refine the best, relate them, and map the sky for the best period.

    Raises
    ------
    InputError
    """
    if settings.reflectance not in DIFFUSE_LAWS:
        raise InputError(
            f"unknown law of reflection {settings.reflectance!r}; available: "
            f"{', '.join(DIFFUSE_LAWS)}"
        )
    spins = settings.period_h is not None or settings.period_range_h is not None
    if not (spins or settings.laws):
        raise InputError(
            "nothing to try: give --period HOURS, --period-range FROM,TO or --law NAME "
            "(--law all for the catalogue of stabilised attitudes)"
        )
    points = points_of(curve, settings)
    flux = relative(curve)
    scan = AttitudeScan(
        settings,
        [],
        curve.n_obs,
        0,
        points.error_known,
        curve.frame,
        curve.t,
        curve.curve,
        flux,
        epoch_jd=curve.epoch_jd,
        curve_titles=curve.dated_titles,
    )
    chosen, scan.left_out = stabilised.chosen(settings.laws, curve, settings.period_h)
    scan.n_laws = len(chosen)
    with worker_pool(scheduler, n_workers) as workers:
        if settings.sparse:
            points = _sparse_spins(
                curve, points, settings, scan, workers, checkpoint, progress, further
            )
        elif spins:
            _spins(curve, points, settings, scan, workers, checkpoint, progress)
        if chosen:
            with _timed(scan, "laws_s"), progress.stage("laws", len(chosen), "laws") as track:
                fitted, dark = stabilised.fit_laws(
                    curve, chosen, settings.reflectance, workers, track
                )
                scan.solutions += fitted
                scan.left_out |= dark
    if not settings.sparse:  # those of the most probable period come first
        scan.solutions.sort(key=lambda s: s.chi2)
    best = scan.solutions[0]
    scan.dof = max(curve.n_obs - best.n_fitted - points.n_factors, 1)
    if not points.error_known and best.coefficients is None:
        _rescaled(scan)
    relate(scan, Geometry.of(points))
    return scan


def _spins(
    curve: LightCurve,
    points: Points,
    settings: Settings,
    scan: AttitudeScan,
    run: Run,
    checkpoint: Checkpoint,
    progress: Silent,
) -> None:
    """Add constant spins to ``scan``: screen them, map the sky, and refine the best."""
    span = float(points.span)
    closed = settings.smooth
    coarse = _coarse(settings, closed)
    fine = SmoothBody.of(settings.n_facets, settings.degree, settings.reflectance, closed=closed)
    ends = _screened(points, settings, coarse, scan, run, checkpoint, progress)
    kept, _ = distinct(ends, span, settings.keep)
    if settings.n_sky > 0:
        # if few poles were tried, the map may contain better ones
        held = _sky(points, settings, coarse, ends, scan, run, checkpoint, progress)
        kept = Ends.joined([kept, distinct(held, span, FROM_MAP)[0]])
    hits = counted(ends, kept, span)
    if not len(hits):
        raise InputError(
            "no hypothesis explains anything of the light curve; check its errors and geometry"
        )
    with (
        _timed(scan, "refine_s"),
        progress.stage("refining", len(hits), "solutions") as track,
    ):
        better = search.refine(points, fine, kept, run, checkpoint, "refine", track)
    if closed:
        scan.solutions += _smooth_solutions(points, fine, *_merged(better, hits, span))
        return
    with (
        _timed(scan, "facets_s"),
        progress.stage("facets", len(hits), "solutions") as track,
    ):
        scan.solutions += _faceted_solutions(curve, settings, better, hits, span, run, track)


def _sparse_spins(
    curve: LightCurve,
    points: Points,
    settings: Settings,
    scan: AttitudeScan,
    run: Run,
    checkpoint: Checkpoint,
    progress: Silent,
    further: nights.Further | None,
) -> Points:
    """Add the probable spins of sparse points to ``scan``: rank all, and refine the most probable.

    Returns the points without the phase law of the most probable spin.
    """
    sparse_points = SparsePoints.of(curve)
    assert settings.period_range_h is not None
    with _timed(scan, "screen_s"), progress.stage("periodogram", 1, "object") as track:
        periods = sparse.search(sparse_points, settings.period_range_h, 0.5 * settings.period_step)
        if curve.n_curves > 1:
            progress.say("comparing the times of each curve with those of the others")
        periods, scan.contradiction = compared(sparse_points, periods)
        track.advance(1)
    scan.n_periods, scan.n_ranked = len(periods.frequencies), periods.n_ranked
    scan.period_probability = periods.period_probability
    scan.screened = sparse.table(periods, curve.n_obs)
    if further is not None:
        with _timed(scan, "nights_s"), progress.stage("nights", 1, "file") as track:
            scan.nights = nights.outlook(sparse_points, periods, curve, further)
            track.advance(1)
    spins = periods.spins[: settings.keep]
    with (
        _timed(scan, "refine_s"),
        progress.stage("refining", len(spins), "solutions") as track,
    ):
        points, ends = refined(points, sparse_points, spins, settings, scan, run, checkpoint, track)
    scan.flux = np.asarray(points.flux)
    if settings.n_sky > 0:
        first = Ends(*(x[:1] for x in ends))
        _sky(points, settings, _coarse(settings), first, scan, run, checkpoint, progress)
    return points


def refined(
    points: Points,
    sparse_points: SparsePoints,
    spins: list[sparse.Spin],
    settings: Settings,
    scan: AttitudeScan,
    run: Run,
    checkpoint: Checkpoint,
    track: Track,
) -> tuple[Points, Ends]:
    """Add the bodies of the most probable spins of sparse points to ``scan``.

    Returns the points without the phase law of the first spin, and the end points.
    """
    fine = SmoothBody.of(settings.n_facets, settings.degree, settings.reflectance)
    points = sparse.without_phase_law(points, sparse_points, fine, spins[0])
    ends = search.refine(points, fine, sparse.ends(spins), run, checkpoint, "refine", track)
    bodies = _smooth_solutions(points, fine, ends, np.ones(len(spins), int))
    for body, spin in zip(bodies, spins, strict=True):
        scan.solutions.append(replace(body, probability=spin.probability))
    return points, ends


def points_of(curve: LightCurve, settings: Settings) -> Points:
    """The points of a light curve as a scan with these settings reads them."""
    return Points.of(
        curve,
        phase_law_known=not settings.smooth,
        common_noise=settings.common_noise,
        phase_laws=settings.smooth and curve.frame == "ecliptic-j2000",
    )


def _coarse(settings: Settings, closed: bool = True) -> SmoothBody:
    """The body used for screening and for the map of the sky."""
    degree = min(COARSE_DEGREE, settings.degree)
    single = np.float32
    return SmoothBody.of(COARSE_FACETS, degree, settings.reflectance, closed=closed, dtype=single)


def _screened(
    points: Points,
    settings: Settings,
    coarse: SmoothBody,
    scan: AttitudeScan,
    run: Run,
    checkpoint: Checkpoint,
    progress: Silent,
) -> Ends:
    """Every hypothesis of the grid, and the aliases of the best one, fitted with a coarse body."""
    span = float(points.span)
    tried = grid(
        settings.n_poles, span, settings.period_h, settings.period_range_h, settings.period_step
    )
    scan.n_periods = len(tried.frequencies)
    with (
        _timed(scan, "screen_s"),
        progress.stage("scanning", tried.size, "hypotheses") as track,
    ):
        ends = search.screen(points, coarse, tried, run, checkpoint, "screen", track)
        others = _aliases(tried, float(ends.frequency[np.argmin(ends.value)]), span)
    with (
        _timed(scan, "aliases_s"),
        progress.stage("period aliases", others.size, "hypotheses") as track,
    ):
        more = search.screen(points, coarse, others, run, checkpoint, "alias", track)
    poles, frequencies = (np.concatenate(x) for x in zip(tried.rows(), others.rows(), strict=True))
    ends = Ends.joined([ends, more])
    chi2 = search.misfit(points, ends.squares, _least(ends))
    scan.screened = Table(poles, frequencies, ends.pole, ends.frequency, chi2, ends.steps)
    return ends


def _sky(
    points: Points,
    settings: Settings,
    coarse: SmoothBody,
    ends: Ends,
    scan: AttitudeScan,
    run: Run,
    checkpoint: Checkpoint,
    progress: Silent,
) -> Ends:
    """The sky mapped at the best frequency, with the pole fixed at each point of a grid."""
    with _timed(scan, "sky_s"), progress.stage("sky", settings.n_sky, "poles") as track:
        poles, best = facets.grid(settings.n_sky), float(ends.frequency[np.argmin(ends.value)])
        held = search.sky(points, coarse, poles, best, run, checkpoint, track)
        scan.sky = poles, search.misfit(points, held.squares, _least(ends))
    return held


def _least(ends: Ends) -> Floats:
    """Sums of squares (K,) of the best hypothesis."""
    return ends.squares[np.argmin(ends.value)]


@contextmanager
def _timed(scan: AttitudeScan, name: str) -> Iterator[None]:
    begun = time.monotonic()
    yield
    scan.timing[name] = time.monotonic() - begun


def _aliases(tried: Grid, best: float, span: float) -> Grid:
    """Aliases of the best frequency: twice and half its value and, if only one period was tried,
    the frequencies that differ by half a turn over the data."""
    others = [2.0 * best, 0.5 * best]
    if len(tried.frequencies) == 1:
        others += [f for k in (-0.5, 0.5) if (f := best + k / span) > 0]
    return Grid(tried.poles, np.array(others))


def _smooth_solutions(
    points: Points, body: SmoothBody, ends: Ends, hits: NDArray
) -> list[Solution]:
    chi2 = search.misfit(points, ends.squares, ends.squares[0])
    residual = search.residuals(points, body, ends)
    normals = facets.grid(body.normals.shape[0])
    out = []
    for i in range(len(hits)):
        _, _, shape = in_convention(ends.tilt[i], ends.coefficients[i])
        log_area = np.asarray(body.harmonics, float) @ shape
        areas = np.exp(log_area - log_area.max())
        out.append(
            Solution(
                "constant-rate",
                float(chi2[i]),
                _rms(residual[i]),
                residual[i],
                normals,
                areas / areas.sum(),
                int(hits[i]),
                ends.pole[i],
                float(ends.frequency[i]),
                shape,
            )
        )
    return out


def _merged(ends: Ends, hits: NDArray, span: float) -> tuple[Ends, NDArray]:
    """Merge end points that belong to the same solution, and add their hits."""
    unique, _ = distinct(ends, span, len(hits))
    return unique, counted(ends, unique, span, hits)


def _faceted_solutions(
    curve: LightCurve,
    settings: Settings,
    ends: Ends,
    hits: NDArray,
    span: float,
    run: Run,
    track: Any,
) -> list[Solution]:
    """The spins refined with free facets; solutions that converge to the same spin are merged."""
    rows = [(ends.tilt[i], float(ends.frequency[i])) for i in range(len(hits))]
    done: dict[int, tuple] = {}
    for i, body in run(_polished, (curve, span, settings.reflectance), rows):
        done[i] = body
        track.advance(1)
    turned = [done[i][0] for i in range(len(rows))]
    ends = Ends(
        np.array([s.tilt for s in turned]),
        np.array([s.frequency for s in turned]),
        ends.coefficients,
        np.array([0.5 * done[i][1].chi2 for i in range(len(rows))]),
        ends.squares,
        np.arange(len(rows)),
    ).forward()
    merged, hits = _merged(ends, hits, span)
    out = []
    for k, i in enumerate(merged.steps):  # its original row
        body = done[int(i)][1]
        residual = relative(curve) - relative(curve, body.flux)
        out.append(
            Solution(
                "constant-rate",
                body.chi2,
                _rms(residual),
                residual,
                body.normals,
                body.areas / body.areas.sum(),
                int(hits[k]),
                merged.pole[k],
                float(merged.frequency[k]),
            )
        )
    return out


def _polished(shared: tuple, tilt: Floats, frequency: float) -> tuple:
    curve, span, law = shared
    start = Spinning(tilt, frequency, 0.5 * float(np.ptp(curve.t)))
    return polish(curve, start, span, Material.parse(law))


def relative(curve: LightCurve, flux: Floats | None = None) -> Floats:
    """Flux (by default the observed) over the observed mean of its curve, (T,)."""
    observed, _ = linear_flux(curve, Epochs.of(curve))
    mean = np.bincount(curve.curve, np.abs(observed)) / np.bincount(curve.curve)
    return (observed if flux is None else flux) / mean[curve.curve]


def _rms(residual: Floats) -> float:
    return float(np.sqrt(np.mean(residual**2)))


def _rescaled(scan: AttitudeScan) -> None:
    """Rescale χ² to the noise level of the best solution, for unknown errors."""
    by = scan.dof / max(scan.solutions[0].chi2, 1e-20)
    scan.solutions = [replace(s, chi2=s.chi2 * by) for s in scan.solutions]


def relate(scan: AttitudeScan, geometry: Geometry) -> None:
    """Name the relation of each solution to the best."""
    best = scan.solutions[0]
    related = []
    for s in scan.solutions:
        if s is best:
            name, words = "best", "the best"
        elif s.pole is None or best.pole is None:
            name, words = "law", "another law"
        else:
            assert s.frequency is not None
            assert best.frequency is not None
            name, words = geometry.relation(s.pole, s.frequency, best.pole, best.frequency)
        related.append(replace(s, relation=name, words=words))
    scan.solutions = related


__all__ = ["HOUR_S", "Settings", "refined", "relate", "run"]
