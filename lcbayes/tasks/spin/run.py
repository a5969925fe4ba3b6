"""`lcbayes.spin`."""

from __future__ import annotations

from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.spin import estimate
from lcbayes.tasks.spin.options import TASK, SpinOptions
from lcbayes.tasks.spin.result import SpinResult
from lcbayes.tasks.task import Context, task_function


@task_function(TASK)
def spin(curve: LightCurve, options: SpinOptions, context: Context) -> SpinResult:
    """Sidereal period and pole of a spinning object, without a shape.

    The synodic period varies as the phase-angle bisector moves around the pole. A fit to this
    variation along several passes gives the pole and the sidereal period.

    {parameters}

    Returns
    -------
    SpinResult
        ``data`` is a `lcbayes.inversion.spin.Spin`; ``summary()`` has one row per solution.

    Raises
    ------
    InputError
        The light curve or an option is invalid.

    References
    ----------
    Hall et al. 2007, AMOS Conference, sec. 4.1.

    Examples
    --------
    >>> import lcbayes
    >>> curve = lcbayes.simulate("box-wing", seed=1).data
    >>> result = lcbayes.spin(curve, shuffles=99)
    >>> result.trusted
    False
    """
    estimated = estimate(
        curve, n_shuffles=options.shuffles, seed=options.seed, progress=context.progress
    )
    return SpinResult(estimated, curve)
