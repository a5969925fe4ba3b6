"""`lcbayes.albedo_area`."""

from __future__ import annotations

from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.albedo_area.inversion import InversionSettings, invert
from lcbayes.inversion.albedo_area.kernel import Material
from lcbayes.tasks.albedo_area.options import TASK, AlbedoAreaOptions
from lcbayes.tasks.albedo_area.result import AlbedoAreaResult
from lcbayes.tasks.task import Context, task_function


@task_function(TASK)
def albedo_area(
    curve: LightCurve, options: AlbedoAreaOptions, context: Context
) -> AlbedoAreaResult:
    """Albedo-area distribution, shape cues and convex shape of an object of known attitude.

    The flux is linear in the albedo-areas α of facets of fixed normals, f(t) = Σ αᵢ kᵢ(t). The
    albedo-areas are obtained by non-negative least squares on a grid of normals. Areas that close,
    |Σ α n| ≪ Σ α, determine one convex body (Minkowski). The method is exact for a convex body of
    uniform albedo.

    {parameters}

    Returns
    -------
    AlbedoAreaResult
        ``data`` is a `lcbayes.inversion.albedo_area.inversion.Inversion`: normals (N, 3) in the
        body frame, albedo-areas (N,) in m². ``summary()`` has one row per facet, in degrees and m².

    Raises
    ------
    InputError
        The light curve or an option is invalid, or not exactly one attitude is given.

    References
    ----------
    Hall et al. 2007, AMOS Conference, sec. 3, eq. (11).

    Examples
    --------
    >>> import lcbayes
    >>> curve = lcbayes.simulate("two-facet-spin", seed=1).data
    >>> result = lcbayes.albedo_area(
    ...     curve, omega=(0.01, -0.02, 0.05), material="non-lambertian", bootstrap=0, nulls=0
    ... )
    >>> result.summary()["albedo_area_m2"].round(1).tolist()
    [6.0, 3.5]
    """
    inversion = invert(
        curve,
        options.known_attitude(curve),
        [Material.parse(text) for text in options.material],
        settings=InversionSettings(
            n_normals=options.n_normals,
            smoothness=options.smoothness,
            cost=options.facet_cost,
            albedo=options.albedo,
            n_bootstrap=options.bootstrap,
            n_null=options.nulls,
            seed=options.seed,
        ),
        progress=context.progress,
    )
    return AlbedoAreaResult(inversion, curve, options)
