"""`lcbayes.attitude_test`."""

from __future__ import annotations

from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.separated import attitude_test as method
from lcbayes.physics.attitude import catalogue
from lcbayes.tasks.attitude_test.options import TASK, AttitudeTestOptions
from lcbayes.tasks.attitude_test.result import AttitudeTestResult
from lcbayes.tasks.task import Context, task_function


@task_function(TASK)
def attitude_test(
    curve: LightCurve, options: AttitudeTestOptions, context: Context
) -> AttitudeTestResult:
    """Test attitude laws with pairs of measurements of equal geometry, without a shape.

    If a law is true, two measurements with the same directions to Sun and observer in body axes
    have equal brightness for any body. The differences within pairs are ranked among those of
    random bodies under the law.

    {parameters}

    Returns
    -------
    AttitudeTestResult
        ``data`` is a `lcbayes.inversion.separated.attitude_test.AttitudeTest`; ``summary()`` has
        one row per law, with its p-value.

    Raises
    ------
    InputError
        The light curve or an option is invalid, or no p-value can be below the level.

    References
    ----------
    Hall et al. 2007, AMOS Conference, sec. 4.4.

    Examples
    --------
    >>> import lcbayes
    >>> curve = lcbayes.simulate("box-wing", seed=1).data
    >>> result = lcbayes.attitude_test(curve, law=["lvlh", "inertial"], bodies=199)
    >>> sorted(result.summary()["law"])
    ['inertial', 'lvlh']
    """
    laws = [catalogue.parse(text) for text in options.law]
    tested = method.attitude_test(
        curve,
        laws or [law for law in catalogue.distinct() if not law.spins],
        level=options.level,
        separation_deg=options.separation,
        n_bodies=options.bodies,
        seed=options.seed,
        progress=context.progress,
    )
    return AttitudeTestResult(tested, curve, options)
