"""`lcbayes.glints`."""

from __future__ import annotations

from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.glints import analyse
from lcbayes.tasks.glints.options import TASK, GlintsOptions
from lcbayes.tasks.glints.result import GlintsResult
from lcbayes.tasks.task import Context, task_function


@task_function(TASK)
def glints(curve: LightCurve, options: GlintsOptions, context: Context) -> GlintsResult:  # noqa: ARG001
    """Glints of a light curve, and the facets, cylinder or panel that reflect them.

    A glint is seen when the phase-angle bisector passes a facet's normal, b = n, or is
    perpendicular to the axis of a cylinder, c · b = 0. Several glints that satisfy one condition
    determine the direction. The method is exact for mirror-like facets and a known attitude.

    {parameters}

    Returns
    -------
    GlintsResult
        ``data`` is a `lcbayes.inversion.glints.attitude.Glints`: unit vectors (3,) in body axes,
        times in s. ``summary()`` has one row per direction, in degrees.

    Raises
    ------
    InputError
        The light curve or an option is invalid, or no pass has 30 points.

    References
    ----------
    Hall et al. 2007, AMOS Conference, eqs. (17) and (18).

    Examples
    --------
    >>> import lcbayes
    >>> curve = lcbayes.simulate("box-wing", seed=1).data
    >>> result = lcbayes.glints(curve, omega=(0.012, -0.020, 0.018))
    >>> result.trusted, [reason.code for reason in result.reasons]
    (False, ['no-glint'])
    """
    analysed = analyse(
        curve,
        options.known_attitude(curve),
        axis=options.sun_tracking,
        alarm=options.alarm,
        longest_s=options.longest,
    )
    return GlintsResult(analysed, curve, options)
