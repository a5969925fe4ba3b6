"""`lcbayes.fit`."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from lcbayes.core.errors import InputError
from lcbayes.core.files import printable
from lcbayes.core.options import option
from lcbayes.core.progress import Silent
from lcbayes.core.reasons import Finding, Reason
from lcbayes.core.version import installed_version
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inference import facet_count, sparse
from lcbayes.inference import fit as engine
from lcbayes.inference.identity import identity as identity_of
from lcbayes.inference.rival import rival
from lcbayes.inference.sparse import SparsePath
from lcbayes.inference.start_from import SPINS_FREELY
from lcbayes.modelling import registry
from lcbayes.modelling.options import PRIORS, ModelOptions
from lcbayes.modelling.registry import Entry
from lcbayes.results import posterior as results
from lcbayes.results import rivals
from lcbayes.results.asteroid import asteroids, body_content
from lcbayes.results.start import Start, read_start
from lcbayes.results.summary import summarise
from lcbayes.samplers.settings import WARMUP, Settings
from lcbayes.tasks.fit.assumptions import assumptions
from lcbayes.tasks.fit.options import TASK, FitOptions
from lcbayes.tasks.fit.result import Fit
from lcbayes.tasks.task import Context, execute, task_function


@task_function(TASK)
def fit(curve: LightCurve, options: FitOptions, context: Context) -> Fit:
    """Posterior over shape, spin and surface from a light curve.

    A search from many starts finds the solutions. Each solution is sampled by its own chains, and
    its weight is its share of the evidence.

    {parameters}

    Returns
    -------
    Fit
        ``data`` is the DataTree of ``posterior.nc``; ``summary()`` has one row per parameter of
        each solution.

    Raises
    ------
    InputError
        The light curve or an option is invalid.

    Examples
    --------
    >>> import lcbayes
    >>> import numpy as np
    >>> angle = np.linspace(0.0, 1.0, 20)
    >>> sun = np.tile([1.0, 0.0, 0.0], (20, 1))
    >>> obs = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    >>> flux = 3.0 + np.cos(angle)
    >>> curve = lcbayes.LightCurve(t=60.0 * angle, brightness=flux, error=0 * flux + 0.1,
    ...     sun=sun, obs=obs, kind="flux", free_scale=np.array([False]))
    >>> result = lcbayes.fit(curve, n_facets=1, spin="none", seed=1, num_starts=16,
    ...     num_warmup=10, num_samples=20, num_chains=2)
    >>> result.trusted                     # 40 draws are too few
    False
    >>> list(result.summary()["parameter"])
    ['albedo_area[0]', 'g[0]', 'phi[0]']
    """
    return _fitted(curve, options, context)


@dataclass(frozen=True)
class KernelOptions(FitOptions):
    """Options of `fit_with_kernel`: those of `lcbayes.fit`, with all kernels."""

    sampler: str = option("auto", choices=tuple(WARMUP), help="name of the kernel")


def fit_with_kernel(
    curve: LightCurve,
    sampler: str,
    *,
    out: str | Path | None = None,
    report: bool = False,
    progress: Silent | None = None,
    **given: Any,
) -> Fit:
    """`lcbayes.fit` with a kernel provided for comparison.

    ``hmc``, ``rmhmc`` and ``mh`` are exact and slower than the kernels of `lcbayes.fit`.
    ``ahmc-paper`` follows the published rule, which does not leave the posterior invariant, so its
    result is never trusted. The kernels are in `lcbayes.samplers.kernels`, for
    `numpyro.infer.MCMC`.

    Parameters
    ----------
    curve : LightCurve
    sampler : name of a kernel in `lcbayes.samplers.settings.WARMUP`
    out, report, progress, **given
        As for `lcbayes.fit`.

    Returns
    -------
    Fit
    """
    options = KernelOptions.of({"sampler": sampler, **given})
    return execute(TASK, _fitted, curve, options, out, report, progress)


def _fitted(curve: LightCurve, options: FitOptions, context: Context) -> Fit:
    settings = Settings(
        options.sampler,
        options.seed,
        options.num_warmup,
        options.num_samples,
        options.num_chains,
        options.num_starts,
        options.max_modes,
    )
    entry = registry.find(options.model)
    check_curve(curve)
    check_pole(curve, options)
    spins, asked, doubt = [], options.for_model, ""
    if options.start_from is not None:
        start = read_start(options.start_from, curve)
        doubt = "" if "period" in asked else start.doubt
        spins, asked = _started(start, entry, asked)
    if PRIORS in asked:
        entry = entry.with_priors(asked.pop(PRIORS))
    checked = entry.check(asked)
    if options.sparse is not None:
        _check_sparse(entry, options)
    identity = identity_of(curve, entry, checked, settings, installed_version())
    if PRIORS in options.others:
        identity[PRIORS] = options.as_dict()[PRIORS]
    if options.sparse is not None:
        identity |= {"sparse": options.sparse}
    if spins:
        identity |= {"start_from": repr(spins)}
    checkpoint = context.checkpoint(identity)
    path = None
    if options.sparse is not None:
        arguments = (curve, entry, checked, options.sparse, settings, checkpoint, context.progress)
        path = facet_count.reduced(*arguments)
        checked = checked | {"n_facets": path.n_facets}
        checked.pop("sparsity", None)
    posterior = engine.run(curve, entry, checked, settings, checkpoint, context.progress, spins)
    if doubt:
        posterior.reasons.insert(0, Finding("period-of-scan", {"why": doubt}))
    context.progress.say("checking the draws: predicted brightness, leave-one-out")
    return assembled(posterior, curve, entry, checked, identity, path, context.progress)


def assembled(
    posterior: engine.Posterior,
    curve: LightCurve,
    entry: Entry,
    options: Mapping[str, Any],
    identity: Mapping[str, Any],
    path: SparsePath | None = None,
    progress: Silent | None = None,
) -> Fit:
    """The result of a posterior: its DataTree, summary and verdict."""
    seed = posterior.settings.seed
    tree = results.tree(posterior, curve, entry, options, seed)
    hook = entry.hook("shadows_left_out")
    shadows_of = None if hook is None else partial(hook, **options)
    other = None
    if entry.rival:
        drawn = (tree[f"modes/{i}/posterior"] for i in range(len(posterior.modes)))
        draws = [{k: d[k].to_numpy() for k in rivals.WORDS} for d in drawn]
        other = rival(entry, options, curve, posterior, draws, progress or Silent())
    content, reasons = summarise(posterior, tree, curve, identity, seed, shadows_of, other)
    content["model_options"] = dict(options)
    if path is not None:
        content["sparse"] = asdict(path)
    stated = {**options, **{k: identity[k] for k in (PRIORS,) if k in identity}}
    tree.attrs |= _attributes(curve, content["n_facets"], entry, seed, stated)
    if path is not None:
        listed = [*json.loads(tree.attrs["assumptions"]), path.sentence]
        tree.attrs["assumptions"] = json.dumps(listed)
    tree.attrs |= _verdict(reasons)
    for mode, solution in zip(content["modes"], asteroids(tree), strict=False):
        mode["body"] = body_content(solution)
    return Fit(tree, content, reasons)


def _started(
    start: Start, entry: Entry, asked: Mapping[str, Any]
) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """The spins from which the search starts, and the options with the periods of a start.

    Raises
    ------
    InputError
        The model has no spin, or needs a pole that was not found.
    """
    period = entry.options.get("period")
    if period is None and start.periods:
        raise InputError(SPINS_FREELY)
    own = entry.hook("search") is not None  # over all spins, which needs no other start
    if period is None or (period.type is str and not start.periods and not own):
        return start.spins, dict(asked)
    if period.type is str:  # a prior, which the search over all spins keeps to
        return [], {"period": start.ranges, **asked}
    if not start.spins:
        raise InputError(
            f"the spin found no pole, which {entry.name} starts from; scan the periods "
            f"{start.periods} with lcbayes scan first"
        )
    return start.spins, {"period": start.spins[0]["period_h"], **asked}


def check_pole(curve: LightCurve, options: ModelOptions) -> None:
    """Raise an InputError if a pole is given whose axes are not those of the light curve."""
    if options.pole is not None and curve.frame == "ecliptic-j2000":
        raise InputError(
            "--pole is right ascension and declination, and the directions of this file are "
            "ecliptic; give no --pole, or a light curve in GCRS"
        )


def _check_sparse(entry: Entry, options: FitOptions) -> None:
    sparse.check(entry, options.sparse or 0)
    if options.n_facets is not None:
        raise InputError(
            "--sparse finds the number of facets, and --n-facets gives it; give one of them"
        )


def check_curve(curve: LightCurve) -> None:
    """Raise an InputError if there is nothing to fit."""
    if curve.geometry_only:
        raise InputError("the curve has no brightness to fit; add a column flux or mag")
    if curve.n_obs < 3:
        raise InputError(f"the curve has {curve.n_obs} points; at least 3 are needed to fit")
    if curve.kind == "flux":
        _check_level(curve)


def _check_level(curve: LightCurve) -> None:
    """Raise an InputError if the fluxes have no level that can serve as a unit."""
    near = 1.0 if curve.range_km is None else curve.range_km**2
    for i, title in enumerate(curve.curve_titles):
        here = curve.curve == i
        which = "the curve" if curve.n_curves == 1 else title
        if curve.free_scale[i] and not np.mean((curve.brightness * near)[here]) > 0:
            raise InputError(
                f"the mean flux of {which} is not positive, so that a scale cannot be found; leave "
                "the curve out, or give calibrated fluxes"
            )
        if curve.error is None and not np.any(curve.brightness[here]):
            raise InputError(
                f"every flux of {which} is 0 and there are no errors, so that a noise level cannot "
                "be found; leave the curve out, or give flux_err"
            )


def _attributes(
    curve: LightCurve, n_facets: int, entry: Entry, seed: int, options: Mapping[str, Any]
) -> dict[str, Any]:
    return {
        "model": printable(entry.name),
        "n_facets": n_facets,
        "seed": seed,
        "version": installed_version(),
        "command": "lcbayes fit --config run.toml",
        "source_file": str(curve.source.get("file", "")),
        "assumptions": json.dumps(assumptions(curve, entry, options)),
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def _verdict(reasons: Sequence[Reason]) -> dict[str, Any]:
    return {
        "trusted": int(not reasons),
        "reasons": json.dumps([reason._asdict() for reason in reasons]),
    }
