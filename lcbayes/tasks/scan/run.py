"""`lcbayes.scan`."""

from __future__ import annotations

from lcbayes.core.version import installed_version
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inference.fit import digest
from lcbayes.inversion.attitude_scan import engine
from lcbayes.inversion.attitude_scan.verdict import summarise
from lcbayes.results.reasons import reasons
from lcbayes.tasks.fit.run import check_curve
from lcbayes.tasks.scan.options import TASK, ScanOptions
from lcbayes.tasks.scan.result import Scan
from lcbayes.tasks.task import Context, task_function

ASTEROID, SATELLITE = "lommel-seeliger-lambert", "non-lambertian"


@task_function(TASK)
def scan(curve: LightCurve, options: ScanOptions, context: Context) -> Scan:
    """Rank attitude hypotheses, each with its best-fitting body, and refine the best ones.

    Constant spins: every pole of a grid is combined with every period of a range, and each pair is
    refined by Levenberg-Marquardt over pole, period and a smooth convex body. Laws: each stabilised
    attitude of the catalogue is fitted with facets on a grid. The scan is deterministic.

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
    settings = engine.Settings(
        options.period,
        None
        if options.period_range is None
        else (options.period_range[0], options.period_range[1]),
        options.law,
        options.reflectance or (ASTEROID if asteroid else SATELLITE),
        options.n_poles,
        options.period_step,
        options.n_facets,
        options.degree,
        options.keep,
        options.n_sky,
        options.common_noise,
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
    )
    content, against = summarise(complete, curve)
    return Scan(complete, content, reasons(against))
