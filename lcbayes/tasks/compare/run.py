"""`lcbayes.compare`."""

from __future__ import annotations

from collections.abc import Sequence

from lcbayes.core.errors import InputError
from lcbayes.core.version import installed_version
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inference import facet_count as engine
from lcbayes.inference.fit import identity as identity_of
from lcbayes.modelling import registry
from lcbayes.modelling.registry import Entry
from lcbayes.results.comparison import summarise
from lcbayes.samplers.settings import PARTICLES, Settings
from lcbayes.tasks.compare.options import MOST, TASK, CompareOptions
from lcbayes.tasks.compare.result import Comparison
from lcbayes.tasks.fit.run import check_curve
from lcbayes.tasks.task import Context, task_function


@task_function(TASK)
def compare(curve: LightCurve, options: CompareOptions, context: Context) -> Comparison:
    """Compare numbers of facets for a light curve.

    For each number, independent runs of tempered particles from the prior to the posterior give the
    evidence; the scatter between runs gives its error. The predictive densities of left-out epochs
    are also given. They answer a different question: which number predicts best, not which is true.

    {parameters}

    Returns
    -------
    Comparison
        ``summary()`` has one row per number of facets.

    Raises
    ------
    InputError
        The light curve or an option is invalid.

    References
    ----------
    Linares & Crassidis 2017, J. Guid. Control Dyn., sec. VI, for the sparse path.

    Examples
    --------
    >>> import lcbayes
    >>> import numpy as np
    >>> angle = np.linspace(0.0, 1.0, 12)
    >>> sun = np.tile([1.0, 0.0, 0.0], (12, 1))
    >>> obs = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    >>> flux = 3.0 + np.cos(angle)
    >>> curve = lcbayes.LightCurve(t=60.0 * angle, brightness=flux, error=0 * flux + 0.1,
    ...     sun=sun, obs=obs, kind="flux", free_scale=np.array([False]))
    >>> result = lcbayes.compare(curve, n_facets=[1, 2], spin="none", num_particles=10, num_runs=2)
    >>> list(result.summary()["n_facets"])
    [1, 2]
    """
    entry, counts = registry.find(options.model), list(options.n_facets)
    _check_model(entry, options.sparse, counts)
    asked = {k: v for k, v in options.for_model.items() if k != "n_facets"}
    checked = entry.check({**asked, "n_facets": counts[0]})
    del checked["n_facets"]
    check_curve(curve)
    settings = Settings(
        PARTICLES, options.seed, None, options.num_particles, options.num_runs, options.num_starts
    )
    identity = identity_of(curve, entry, checked, settings, installed_version())
    identity |= {"facets": ",".join(map(str, counts)), "sparse": options.sparse or 0}
    checkpoint = context.checkpoint(identity)
    found = engine.run(
        curve, entry, checked, counts, settings, options.sparse, checkpoint, context.progress
    )
    content, reasons = summarise(found, identity, curve.n_obs, options.seed)
    return Comparison(content, reasons, {})


def _check_model(entry: Entry, sparse: int | None, counts: Sequence[int]) -> None:
    """Check that the model supports the comparison."""
    if "n_facets" not in entry.options or entry.hook("starts") is not None:
        raise InputError(
            f"--model {entry.name} has no number of facets to compare; available: faceted, "
            "faceted-brdf, stabilised, or a file whose model has an option n_facets"
        )
    if sparse is None:
        return
    asked = {"sparsity", "log_area_sd"}
    if not asked <= set(entry.options) or "normals_base" not in entry.facet_sites:
        raise InputError(
            f"--sparse goes with faceted and faceted-brdf: {entry.name} lacks their options "
            "sparsity and log_area_sd, or their site normals_base"
        )
    if not counts[0] < sparse <= MOST:
        raise InputError(
            f"--sparse is {sparse}; give an upper bound of facets from {counts[0] + 1} to {MOST}"
        )
