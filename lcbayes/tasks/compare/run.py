"""`lcbayes.compare`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from lcbayes.core.errors import InputError
from lcbayes.core.version import installed_version
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inference import body_kind
from lcbayes.inference import facet_count as engine
from lcbayes.inference.body_kind import Kind
from lcbayes.inference.fit import Posterior
from lcbayes.inference.identity import identity as identity_of
from lcbayes.inference.sparse import check as check_sparse
from lcbayes.modelling import registry
from lcbayes.modelling.options import PRIORS
from lcbayes.modelling.registry import Entry
from lcbayes.results.comparison import summarise
from lcbayes.samplers.settings import PARTICLES, Settings
from lcbayes.tasks.compare.options import CHAINS, MOST, TASK, CompareOptions, kinds_of
from lcbayes.tasks.compare.result import Comparison
from lcbayes.tasks.fit.result import Fit
from lcbayes.tasks.fit.run import assembled, check_curve, check_pole
from lcbayes.tasks.task import Context, task_function


@task_function(TASK)
def compare(curve: LightCurve, options: CompareOptions, context: Context) -> Comparison:
    """Compare numbers of facets, or kinds of body, for a light curve.

    For each number, chains about each solution and bridges give the evidence, or a bridge to one
    facet fewer where a facet is superfluous. Where they cannot be relied on, or with
    ``evidence="particles"``, independent runs of tempered particles from the prior to the posterior
    give it; the scatter between runs gives its error. The predictive densities of left-out epochs
    are also given. They answer a different question: which number predicts best, not which is true.
    With ``bodies=["rocket-stage", "my.toml", "facets:3-4"]``, known bodies and numbers of facets
    are compared together, by chains.
    The prior on the area of each facet is centred at the typical area of the best fit unless
    ``log_area_mean`` or a prior of ``log_albedo_area`` is given, and the result shows how the
    probabilities depend on it. ``priors={"log_albedo_area": dist.Normal(0.0, 0.5)}`` replaces
    priors as in `lcbayes.fit`, for every number of facets.

    {parameters}

    Returns
    -------
    Comparison
        ``summary()`` has one row per number of facets or kind of body.

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
    if options.bodies:
        return _compared_bodies(curve, options, context)
    entry, counts = registry.find(options.model), list(options.n_facets)
    _check_model(entry, options.sparse, counts)
    asked = {k: v for k, v in options.for_model.items() if k != "n_facets"}
    if PRIORS in asked:
        entry = entry.with_priors(asked.pop(PRIORS))
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
    if entry.replaced:
        identity |= {PRIORS: options.as_dict()[PRIORS]}
    checkpoint = context.checkpoint(identity)
    plan = engine.Plan(settings, chains, options.sparse)
    compared = engine.run(curve, entry, checked, counts, plan, checkpoint, context.progress)
    content, reasons = summarise(compared, identity, curve.n_obs, options.seed)
    context.progress.say("checking the draws of each number: predicted brightness, leave-one-out")
    return Comparison(content, reasons, {}, _fits(compared, curve, entry, identity))


def _compared_bodies(curve: LightCurve, options: CompareOptions, context: Context) -> Comparison:
    """Compare known bodies and numbers of facets."""
    check_curve(curve)
    check_pole(curve, options)
    kinds = _kinds(options)
    settings = Settings(seed=options.seed, num_chains=options.num_runs)
    named = {f"{k.name}.{key}": value for k in kinds for key, value in k.options.items()}
    identity = identity_of(curve, kinds[0].entry, named, settings, installed_version())
    checkpoint = context.checkpoint(identity)
    compared = body_kind.run(curve, kinds, settings, checkpoint, context.progress)
    content, reasons = summarise(compared, identity, curve.n_obs, options.seed)
    content["model"] = ", ".join(dict.fromkeys(k.entry.name for k in kinds))
    context.progress.say("checking the draws of each body: predicted brightness, leave-one-out")
    entries = {k.name: k.entry for k in kinds}
    fits: dict[int | str, Fit] = {
        c.body: _fit_of(c.posterior, curve, entries[c.body], c.options, identity)
        for c in compared.candidates
        if c.posterior is not None
    }
    return Comparison(content, reasons, {}, fits)


def _kinds(options: CompareOptions) -> list[Kind]:
    """The kinds of body, each with the options that its model has and whose value it allows."""
    asked = {k: v for k, v in options.for_model.items() if k not in ("n_facets", "bodies")}
    if PRIORS in asked:
        raise InputError("priors are replaced for numbers of facets; leave out bodies")
    kinds, used = [], set[str]()
    for name, n in kinds_of(options.bodies):
        entry = registry.find(options.model if n else "body")
        if n:
            _check_model(entry, None, [n])
        own = {
            k: v
            for k, v in asked.items()
            if k in entry.options and (not (c := entry.options[k].choices) or v in c)
        }
        used |= set(own)
        given = own | ({"n_facets": n} if n else {"body": name})
        kinds.append(Kind(name, entry, entry.check(given), n))
    if unused := sorted(set(asked) - used):
        raise InputError(
            f"none of the bodies has the option {unused[0]!r} with the value {asked[unused[0]]!r}; "
            "see lcbayes models body, and that of the facets"
        )
    return kinds


def _fits(
    compared: engine.Compared, curve: LightCurve, entry: Entry, identity: Mapping[str, Any]
) -> dict[int | str, Fit]:
    """The posterior of each number of facets, as the result of a fit."""
    fits: dict[int | str, Fit] = {}
    for c in compared.candidates:
        if c.posterior is not None:
            options = {**compared.options, "n_facets": c.n_facets}
            fits[c.n_facets] = _fit_of(c.posterior, curve, entry, options, identity)
    return fits


def _fit_of(
    posterior: Posterior,
    curve: LightCurve,
    entry: Entry,
    options: Mapping[str, Any],
    identity: Mapping[str, Any],
) -> Fit:
    """One posterior of a comparison as the result of a fit."""
    fit = assembled(posterior, curve, entry, options, identity)
    fit.tree.attrs["command"] = "lcbayes compare --config ../run.toml"
    return fit


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
