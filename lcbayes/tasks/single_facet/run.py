"""`lcbayes.single_facet`."""

from __future__ import annotations

from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.separated import single_facet as method
from lcbayes.physics.attitude import catalogue
from lcbayes.tasks.single_facet.options import TASK, SingleFacetOptions
from lcbayes.tasks.single_facet.result import SingleFacetResult
from lcbayes.tasks.task import Context, task_function


@task_function(TASK)
def single_facet(
    curve: LightCurve,
    options: SingleFacetOptions,
    context: Context,  # noqa: ARG001
) -> SingleFacetResult:
    """Orientation of one large facet, from the brightening or dimming as it appears or disappears.

    The facet with normal n is lit and seen while n · s > 0 and n · o > 0. It then adds
    α (n · s)(n · o)/π to a smooth remainder. The likelihood of n on a grid over the sphere gives
    its 90 % region.

    {parameters}

    Returns
    -------
    SingleFacetResult
        ``data`` is a `lcbayes.inversion.separated.single_facet.SingleFacet`: ``normal`` (3,) in the
        body axes of the law, ``albedo_area`` in m². ``summary()`` has one row, in degrees and m².

    Raises
    ------
    InputError
        The light curve or an option is invalid: no errors, no pass with enough points, or no orbit
        although the law needs one.

    References
    ----------
    Hall et al. 2007, AMOS Conference, sec. 4.3 and fig. 2.

    Examples
    --------
    >>> import lcbayes
    >>> curve = lcbayes.simulate("box-wing", seed=1).data
    >>> result = lcbayes.single_facet(curve, law="inertial")
    >>> result.trusted
    False
    """
    name = options.law or ("inertial" if curve.velocity_km_s is None else "lvlh")
    analysed = method.single_facet(curve, catalogue.parse(name), seed=options.seed)
    return SingleFacetResult(analysed, curve)
