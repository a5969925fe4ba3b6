"""`lcbayes.compare`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from lcbayes.core.errors import InputError
from lcbayes.core.version import installed_version
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inference import facet_count as engine
from lcbayes.inference.fit import identity as identity_of
from lcbayes.inference.sparse import check as check_sparse
from lcbayes.modelling import registry
from lcbayes.modelling.registry import Entry
from lcbayes.results.comparison import summarise
from lcbayes.samplers.settings import PARTICLES, Settings
from lcbayes.tasks.compare.options import CHAINS, MOST, TASK, CompareOptions
from lcbayes.tasks.compare.result import Comparison
from lcbayes.tasks.fit.result import Fit
from lcbayes.tasks.fit.run import assembled, check_curve, check_pole
from lcbayes.tasks.task import Context, task_function


@task_function(TASK)
def compare(curve: LightCurve, options: CompareOptions, context: Context) -> Comparison:
    """Compare numbers of facets for a light curve.

    For each number, independent runs of tempered particles from the prior to the posterior give the
    evidence; the scatter between runs gives its error. With ``evidence="chains"``, chains about
    each solution and bridges give it where they agree. The predictive densities of left-out epochs
    are also given. They answer a different question: which number predicts best, not which is true.
    The prior on the area of each facet is centred at the typical area of the best fit unless
    ``log_area_mean`` is given, and the result shows how the probabilities depend on it.

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
    check_pole(curve, options)
    settings = Settings(
        PARTICLES, options.seed, None, options.num_particles, options.num_runs, options.num_starts
    )
    chains = None
    if options.evidence == CHAINS:
        chains = Settings(seed=options.seed, num_chains=options.num_runs)
    identity = identity_of(curve, entry, checked, settings, installed_version())
    identity |= {"facets": ",".join(map(str, counts)), "sparse": options.sparse or 0}
    if chains is not None:
        identity |= {"chains": chains.as_dict()}
    checkpoint = context.checkpoint(identity)
    plan = engine.Plan(settings, chains, options.sparse)
    found = engine.run(curve, entry, checked, counts, plan, checkpoint, context.progress)
    content, reasons = summarise(found, identity, curve.n_obs, options.seed)
    context.progress.say("checking the draws of each number: predicted brightness, leave-one-out")
    return Comparison(content, reasons, {}, _fits(found, curve, entry, identity))


def _fits(
    found: engine.Compared, curve: LightCurve, entry: Entry, identity: Mapping[str, Any]
) -> dict[int, Fit]:
    """The posterior of each number of facets, as the result of a fit."""
    fits = {}
    for c in found.candidates:
        if c.posterior is not None:
            options = {**found.options, "n_facets": c.n_facets}
            fits[c.n_facets] = fit = assembled(c.posterior, curve, entry, options, identity)
            fit.tree.attrs["command"] = "lcbayes compare --config ../run.toml"
    return fits


def _check_model(entry: Entry, sparse: int | None, counts: Sequence[int]) -> None:
    """Check that the model supports the comparison."""
    if "n_facets" not in entry.options or entry.hook("starts") is not None:
        raise InputError(
            f"--model {entry.name} has no number of facets to compare; available: faceted, "
            "faceted-brdf, stabilised, or a file whose model has an option n_facets"
        )
    if sparse is None:
        return
    check_sparse(entry, sparse)
    if not counts[0] < sparse <= MOST:
        raise InputError(
            f"--sparse is {sparse}; give an upper bound of facets from {counts[0] + 1} to {MOST}"
        )
