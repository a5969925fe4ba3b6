"""`lcbayes.scan`."""

from __future__ import annotations

from lcbayes.core.errors import InputError
from lcbayes.core.version import installed_version
from lcbayes.data.lightcurve import LightCurve
from lcbayes.data.read import read_geometry
from lcbayes.inference.identity import digest
from lcbayes.inversion.attitude_scan import engine, sparse
from lcbayes.inversion.attitude_scan.grid import STEP
from lcbayes.inversion.attitude_scan.limits import PERIODS_H
from lcbayes.inversion.attitude_scan.nights import Further
from lcbayes.inversion.attitude_scan.verdict import summarise
from lcbayes.results.reasons import reasons
from lcbayes.tasks.fit.run import check_curve
from lcbayes.tasks.scan.options import AUTO, PERIODOGRAM, TASK, ScanOptions
from lcbayes.tasks.scan.result import Scan
from lcbayes.tasks.task import Context, task_function

ASTEROID, SATELLITE = "lommel-seeliger-lambert", "non-lambertian"
DEGREE, SPARSE_DEGREE = 6, 3


@task_function(TASK)
def scan(curve: LightCurve, options: ScanOptions, context: Context) -> Scan:
    """Rank attitude hypotheses, each with its best-fitting body, and refine the best ones.

    Constant spins: every pole of a grid is combined with every period of a range, and each pair is
    refined by Levenberg-Marquardt over pole, period and a smooth convex body. Laws: each stabilised
    attitude of the catalogue is fitted with facets on a grid. Sparse points of asteroids: a
    periodogram ranks all poles and periods, solutions have probabilities, and the most probable are
    refined; ``nights`` predicts how well further nights would determine the period. The scan is
    deterministic.

    {parameters}

    Returns
    -------
    Scan
        ``data`` holds every hypothesis; ``summary()`` has one row per solution.

    Raises
    ------
    InputError
        The light curve or an option is invalid.

    References
    ----------
    Hall et al. 2007, sec. 3.4; Kaasalainen, Torppa & Muinonen 2001.

    Examples
    --------
    >>> import lcbayes
    >>> import numpy as np
    >>> angle = np.linspace(0.0, 3.0, 12)
    >>> sun = np.tile([1.0, 0.0, 0.0], (12, 1))
    >>> obs = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    >>> flux = 3.0 + np.cos(angle)
    >>> curve = lcbayes.LightCurve(t=60.0 * angle, brightness=flux, error=0 * flux + 0.1,
    ...     sun=sun, obs=obs, kind="flux")
    >>> result = lcbayes.scan(curve, law=["inertial"])
    >>> list(result.summary()["law"])
    ['inertial']
    """
    check_curve(curve)
    asteroid = curve.frame == "ecliptic-j2000"
    sparse_points = _sparse(curve, options)
    asked = options.period_range
    period_range = None if asked is None else (asked[0], asked[1])
    if sparse_points and period_range is None:
        period_range = PERIODS_H
    further = None
    if options.nights is not None:
        if not sparse_points:
            raise InputError("--nights is for sparse points of asteroids, ranked by a periodogram")
        further = Further(read_geometry(options.nights), options.night_error)
    settings = engine.Settings(
        options.period,
        period_range,
        options.law,
        options.reflectance or (ASTEROID if asteroid else SATELLITE),
        options.n_poles,
        options.period_step or (2.0 * sparse.STEP if sparse_points else STEP),
        options.n_facets,
        options.degree or (SPARSE_DEGREE if sparse_points else DEGREE),
        options.keep,
        options.n_sky,
        options.common_noise,
        sparse_points,
    )
    identity = {
        "input": digest(curve),
        "command": "scan",
        "settings": repr(settings),
        "version": installed_version(),
    }
    complete = engine.run(
        curve,
        settings,
        options.scheduler,
        options.workers,
        context.checkpoint(identity),
        context.progress,
        further,
    )
    content, against = summarise(complete, curve)
    return Scan(complete, content, reasons(against))


def _sparse(curve: LightCurve, options: ScanOptions) -> bool:
    """Whether a periodogram is the first stage.

    Raises
    ------
    InputError
        A periodogram is requested together with a single period, laws or another reflectance.
    """
    other = (
        ("--period", options.period is not None),
        ("--law", bool(options.law)),
        ("--reflectance", options.reflectance not in (None, ASTEROID)),
    )
    given = [name for name, present in other if present]
    if options.first_stage == AUTO:
        return not given and sparse.is_sparse(curve)
    if options.first_stage == PERIODOGRAM and given:
        raise InputError(
            f"--first-stage periodogram searches a range of periods; leave out {given[0]}"
        )
    if options.first_stage == PERIODOGRAM and curve.frame != "ecliptic-j2000":
        raise InputError("--first-stage periodogram is for asteroids; leave it out")
    return options.first_stage == PERIODOGRAM
