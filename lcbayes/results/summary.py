"""The summary of a fit: numbers per parameter and mode, and the reasons not to trust them."""

# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownArgumentType=false, reportUnknownVariableType=false
# (pandas, xarray, ArviZ and JAX come without complete types)

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import Any, NamedTuple, cast

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from lcbayes.core.jax_setup import jnp
from lcbayes.core.reasons import Finding, Reason
from lcbayes.data.lightcurve import LightCurve
from lcbayes.geometry.times import Times
from lcbayes.inference import alternatives, goodness_of_fit, misfit_tests, robustness
from lcbayes.inference.alternatives import LATE_CURVE
from lcbayes.inference.fit import Posterior
from lcbayes.inference.goodness_of_fit import Misfit
from lcbayes.inference.late_pass import instead_of_drift
from lcbayes.inference.modes import MAX_LEFT_OUT, Mode
from lcbayes.inference.rival import Rival
from lcbayes.inference.solutions import optimum
from lcbayes.inference.spin_search.cells import Coverage
from lcbayes.inference.spin_solutions import largest_share
from lcbayes.inference.tumbling_search import AGREE, Repeats
from lcbayes.modelling.constrained import reported_draws
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.likelihood import FLUX, OBSERVED, OUTLIER
from lcbayes.modelling.nuisances import CLOCK_SD
from lcbayes.modelling.problem import compiled
from lcbayes.modelling.recorded import Sites
from lcbayes.modelling.variables import SPIN, label, named
from lcbayes.results import rivals
from lcbayes.results.content import (
    FitNumbers,
    FitQuality,
    FitTiming,
    LatePasses,
    ModeContent,
    Outlier,
    Outliers,
    OutlierSite,
    OutlierTime,
    ParameterContent,
    Residuals,
    RunWeights,
    SpinMeans,
)
from lcbayes.results.draws import weighted_draws
from lcbayes.results.posterior import dataset
from lcbayes.results.reasons import cause as in_words
from lcbayes.results.reasons import reasons, why
from lcbayes.results.small_faults import MEASURED_SD, late_passes
from lcbayes.samplers.convergence import MAX_DIVERGING, MAX_RHAT, MIN_ESS
from lcbayes.samplers.sampling import NUM_DRAWS
from lcbayes.samplers.settings import PUBLISHED

Floats = NDArray[np.float64]
type ShadowsOf = Callable[[Sequence[Sites], Epochs], Floats | None]

# Limits of what is trusted, besides those of `samplers.convergence`
SURE_SE = 0.5  # nats; weights with smaller errors are not doubted
MAX_APART = 1.05  # R-hat between independent runs
MAX_SHIFT = 0.5  # sd, by what is left out; 90 % intervals still hold 86 %
SHADOW_DRAWS = 3  # draws at which these are computed, besides the optimum
LIKELY = 0.5  # probability above which a point counts as an outlier


def parameters(draws: Mapping[str, Floats]) -> dict[str, ParameterContent]:
    """Mean, sd, quantiles, R-hat and ESS of each scalar, by ``name`` or ``name[i]``."""
    import arviz as az

    shown = reported_draws(draws)
    data = dataset(shown)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # constant draws give NaN, which the caller handles
        rhat, bulk, tail = az.rhat(data), az.ess(data), az.ess(data, method="tail")
    table: dict[str, ParameterContent] = {}
    for name, values in shown.items():
        quantiles = np.quantile(values, [0.05, 0.5, 0.95], axis=(0, 1))
        for index in np.ndindex(values.shape[2:]):
            at = (slice(None), slice(None), *index)
            table[label(name, index)] = {
                "mean": float(values[at].mean()),
                "sd": float(values[at].std(ddof=1)),
                "q05": float(quantiles[(0, *index)]),
                "q50": float(quantiles[(1, *index)]),
                "q95": float(quantiles[(2, *index)]),
                "rhat": float(rhat[name].values[index]),
                "ess_bulk": float(bulk[name].values[index]),
                "ess_tail": float(tail[name].values[index]),
            }
    return table


def summarise(
    posterior: Posterior,
    tree: xr.DataTree,
    curve: LightCurve,
    identity: Mapping[str, Any],
    seed: int,
    shadows_of: ShadowsOf | None = None,
    rival: Rival | None = None,
) -> tuple[FitNumbers, list[Reason]]:
    """The content of ``summary.json`` besides the verdict, and the reasons against the result.

    ``tree`` is the content of ``posterior.nc``. ``shadows_of`` is `shadows_left_out` of the model;
    see `modelling.registry`. ``rival`` is another body that was fitted for comparison.
    """
    drawn = [
        {str(k): v.values for k, v in tree[f"modes/{i}/posterior"].data_vars.items()}
        for i in range(len(posterior.modes))
    ]
    modes = [_mode(*one) for one in zip(posterior.modes, drawn, strict=True)]
    at_optimum = _at_optimum(posterior, curve, seed, shadows_of)
    moved = _shifts(posterior, at_optimum, curve, modes[0]["parameters"])
    draws = tree["posterior"].to_dataset()
    for mode in modes:
        mode["parameters"] = {named(k, draws): row for k, row in mode["parameters"].items()}
    misfit = at_optimum.misfit
    late = _late_pass(curve, drawn[0], identity["options"])
    findings = [
        *_findings(posterior, modes, misfit),
        *_ignored(at_optimum, moved),
        *_late_curve(misfit, moved, curve),
        *_drift_or_late(late, drawn[0], misfit),
        *rivals.findings(rival),
    ]
    if identity["settings"]["sampler"] == PUBLISHED:
        findings.insert(0, Finding("published-sampler"))
    content: FitNumbers = {
        "model": identity["model"],
        "n_facets": int(tree["posterior"].sizes.get("facet", 0)),
        "n_obs": curve.n_obs,
        "seed": seed,
        "max_rhat": max(m["max_rhat"] for m in modes),
        "min_ess_bulk": min(m["min_ess_bulk"] for m in modes),
        "min_ess_tail": min(m["min_ess_tail"] for m in modes),
        "divergences": sum(m["divergences"] for m in modes),
        # those of the heaviest mode: a mean over several solutions would describe none of them
        "parameters": modes[0]["parameters"],
        "modes": modes,
        "fit": _fit(posterior, tree, curve, misfit),
        "rests_on": {
            fault: {named(q, draws): float(x) for q, x in zip(moved.quantities, shift, strict=True)}
            for fault, shift in moved.by_fault.items()
        },
        **late,
        **rivals.content_of(rival),
        **_outliers(tree, curve),
        "timing": cast("FitTiming", asdict(posterior.timing)),
        "n_starts": posterior.n_starts,
        "search": None if posterior.searched is None else asdict(posterior.searched),
        "spins": [s._asdict() for s in posterior.spins],
        "notes": str(curve.source.get("notes", "")),
        "identity": dict(identity),
    }
    return content, reasons(findings)


def _late_pass(
    curve: LightCurve, draws: Mapping[str, Floats], options: Mapping[str, str]
) -> LatePasses:
    """Late passes that would look like the drift of the rate, if one is measured.

    A tumbling body has no period that could be stated.
    """
    drift, tumbles = draws.get("rate_drift"), any(name.startswith("inertia") for name in draws)
    if drift is None or tumbles or abs(drift.mean()) < MEASURED_SD * drift.std():
        return {}
    clock_sd = float(options.get("clock_sd", CLOCK_SD))
    rate = float(_rate(draws).mean())
    found = instead_of_drift(curve, float(drift.mean()), float(drift.std()), rate, clock_sd)
    return {"late_pass_instead": [one._asdict() for one in found]} if found else {}


def _rate(draws: Mapping[str, Floats]) -> Floats:
    return np.linalg.norm(draws["omega"], axis=-1)


def _drift_or_late(
    late: LatePasses, draws: Mapping[str, Floats], misfit: Misfit
) -> Iterator[Finding]:
    """A period that depends on whether the rate drifts or a pass is late."""
    if misfit.explained and (found := late.get("late_pass_instead")):
        period = float(np.mean(2.0 * np.pi / _rate(draws)))
        yield Finding("drift-or-late-pass", {"period_s": period, "passes": late_passes(found)})


def _mode(mode: Mode, draws: Mapping[str, Floats]) -> ModeContent:
    table = parameters(draws)
    spin = cast("SpinMeans", {k: table[k]["mean"] for k in SPIN if k in table})
    by_run: RunWeights = {}
    if mode.run_weights is not None:
        by_run = {"weight_by_run": mode.run_weights}
    return {
        "weight": mode.weight,
        "weight_sd": mode.weight_sd,
        **by_run,
        "log_evidence": mode.log_evidence.value,
        "log_evidence_se": mode.log_evidence.se,
        "rms": mode.solution.rms,
        "hits": mode.solution.hits,
        "divergences": int(mode.stats["diverging"].sum()),
        "max_rhat": max(_finite(row["rhat"] for row in table.values())),
        "min_ess_bulk": min(_finite(row["ess_bulk"] for row in table.values())),
        "min_ess_tail": min(_finite(row["ess_tail"] for row in table.values())),
        **spin,
        "parameters": table,
    }


def _finite(values: Iterable[float]) -> list[float]:
    """The finite values, or NaN alone."""
    return [v for v in values if np.isfinite(v)] or [float("nan")]


class _AtOptimum(NamedTuple):
    misfit: Misfit
    best: Floats  # z (D,) of the optimum
    shadows: Floats | None = None  # left out: changes of the flux (n, T), first at the optimum
    share: float = 0.0  # of the light that these take


def _at_optimum(
    posterior: Posterior, curve: LightCurve, seed: int, shadows_of: ShadowsOf | None
) -> _AtOptimum:
    """Misfit of the optimum of the heaviest solution, near its most probable draw."""
    problem, data = posterior.problem, posterior.data
    draws = posterior.modes[0].z.reshape(-1, posterior.modes[0].z.shape[-1])
    top = draws[np.argmin(posterior.modes[0].stats["potential_energy"])]
    best, _ = optimum(problem, data, top, np.arange(problem.dim))
    shadows, share = None, 0.0
    if shadows_of is not None:
        sample = np.linspace(0, len(draws) - 1, min(len(draws), SHADOW_DRAWS)).astype(int)
        at = compiled(problem.constrain)
        rows = [at(jnp.asarray(z), data) for z in (best, *draws[sample])]
        shadows = shadows_of(rows, data)
        if shadows is not None:
            share = -float(np.sum(shadows)) / sum(float(np.sum(row[FLUX])) for row in rows)
    further = alternatives.shadows(problem, best, data, None if shadows is None else shadows[0])
    examined = misfit_tests.examine(problem, best, data, curve, seed=seed, further=further)
    misfit = goodness_of_fit.measure(problem, data, best[None], examined)
    return _AtOptimum(misfit, best, shadows, share)


def _shifts(
    posterior: Posterior,
    at_optimum: _AtOptimum,
    curve: LightCurve,
    table: Mapping[str, ParameterContent],
) -> robustness.Shifts:
    sd = {name: row["sd"] for name, row in table.items()}
    problem, data = posterior.problem, posterior.data
    return robustness.shifts(problem, at_optimum.best, data, curve, sd, at_optimum.shadows)


def _ignored(at_optimum: _AtOptimum, moved: robustness.Shifts) -> Iterator[Finding]:
    """Shadows that are left out although they move a quantity by more than `MAX_SHIFT`."""
    shift = moved.by_fault.get("shadows", np.zeros(0))
    if shift.size and shift.max() > MAX_SHIFT:
        what = moved.quantities[int(np.argmax(shift))]
        values = {"percent": 100.0 * at_optimum.share, "shift": float(shift.max()), "what": what}
        yield Finding("shadows-left-out", values)


def _late_curve(misfit: Misfit, moved: robustness.Shifts, curve: LightCurve) -> Iterator[Finding]:
    """A curve that appears late and moves the spin by `MAX_SHIFT`, where the noise is inferred.

    The size of such noise makes up for what the model does not explain, so that patterns of the
    residuals do not refuse the fit.
    """
    cause = None if misfit.examination is None else misfit.examination.cause
    if not misfit.explained or cause is None or cause.name != LATE_CURVE:
        return
    shift = moved.by_curve[curve.dated_titles.index(cause.version)] * abs(cause.amount)
    spin = [i for i, name in enumerate(moved.quantities) if name in rivals.WORDS]
    if spin and shift[spin].max() > MAX_SHIFT:
        most = spin[int(np.argmax(shift[spin]))]
        values = {"shift": float(shift[most]), "what": rivals.WORDS[moved.quantities[most]]}
        yield Finding("curve-appears-late", {"late": in_words(cause), **values})


def _examined(examination: misfit_tests.Examination) -> Residuals:
    """The tests of the residuals and the alternatives, for ``summary.json``."""
    return {
        "false_alarm": misfit_tests.FALSE_ALARM,
        "p_limit": examination.limit,
        "relative_p_limit": examination.relative_limit,
        "even": examination.even,
        "kurtosis": examination.kurtosis,
        "tests": [
            {
                "name": t.name,
                "statistic": t.statistic,
                "p_value": t.p_value,
                "upper_limit": t.upper_limit,
            }
            for t in examination.tests
        ],
        "alternatives": [
            {k: v for k, v in one._asdict().items() if v not in ("", np.inf)}
            for one in examination.explanations
        ],
    }


def _fit(posterior: Posterior, tree: xr.DataTree, curve: LightCurve, misfit: Misfit) -> FitQuality:
    best = posterior.modes[0]
    predicted = tree["log_likelihood"].attrs
    residuals: Residuals = {}
    if misfit.examination is not None:
        residuals = _examined(misfit.examination)
    return {
        "rms": best.solution.rms,
        "information_per_point": float(posterior.data.information),
        "rms_unit": "mag" if curve.kind == "mag" else "relative to the curve's mean",
        "chi2": misfit.chi2,
        "dof": misfit.dof,
        **residuals,
        "elpd_loo": predicted["elpd_loo"],
        "elpd_se": predicted["elpd_loo_se"],
        "max_pareto_k": predicted["max_pareto_k"],
        "log_evidence": posterior.log_evidence.value,
        "log_evidence_se": posterior.log_evidence.se,
    }


def _outliers(tree: xr.DataTree, curve: LightCurve) -> Outliers:
    """Points with a probability above `LIKELY` of being outliers, if the noise law has outliers."""
    predicted = tree["posterior_predictive"]
    if OUTLIER not in predicted:
        return {}
    probability = predicted[OUTLIER].to_numpy()
    drawn = predicted.to_dataset()
    if "solution" in drawn.coords and np.ptp(drawn["solution"].to_numpy()):
        drawn = weighted_draws(drawn)
    middle = drawn[OBSERVED].mean(("chain", "draw")).to_numpy()
    rows = np.flatnonzero(probability > LIKELY)
    moments = None if curve.epoch_jd is None else Times.of(curve.epoch_jd, curve.t[rows])
    outliers: list[Outlier] = []
    for i, k in enumerate(rows):
        when: OutlierTime = {} if moments is None else {"utc": moments.text(i)}
        where: OutlierSite = {"site": str(curve.site[k])} if curve.site[k] else {}
        outliers.append(
            {
                "row": int(k),
                "t": float(curve.t[k]),
                **when,
                "curve": curve.curve_names[curve.curve[k]],
                **where,
                "probability": float(probability[k]),
                "residual": float(curve.brightness[k] - middle[k]),
            }
        )
    return {"outliers": outliers}


def _spin_agreement(entry: ModeContent) -> float | None:
    """R-hat of the rotation if its draws have converged, although others have not."""
    rows = [row for name, row in entry["parameters"].items() if name in SPIN]
    good = all(
        row["rhat"] <= MAX_RHAT and min(row["ess_bulk"], row["ess_tail"]) >= MIN_ESS for row in rows
    )  # false for NaN
    return max(row["rhat"] for row in rows) if rows and good else None


def _findings(posterior: Posterior, modes: list[ModeContent], misfit: Misfit) -> Iterator[Finding]:
    yield from posterior.reasons
    for i, (mode, entry) in enumerate(zip(posterior.modes, modes, strict=True)):
        about = f"solution {i + 1}" if len(modes) > 1 else ""
        error = mode.log_evidence.se
        noticeable = largest_share(mode.weight, error) > MAX_LEFT_OUT
        if len(modes) > 1 and error > SURE_SE and noticeable:
            yield Finding("weight-uncertain", {"se": error}, about)
        # A solution of negligible weight is shown, but its chains do not affect the verdict.
        if mode.weight < 1e-3 and i:
            continue
        draws = mode.stats["diverging"].size
        alone = mode.run_weights is not None and len(mode.z) == 1  # `population` covers this case
        if not entry["max_rhat"] <= MAX_RHAT and not alone:
            agreed = None if about else _spin_agreement(entry)
            values = {"rhat": entry["max_rhat"], "limit": MAX_RHAT, "spin": agreed}
            yield Finding("chains-disagree", values, about)
        for kind in ("bulk", "tail"):
            size = entry["min_ess_bulk"] if kind == "bulk" else entry["min_ess_tail"]
            if not size >= MIN_ESS:
                taken = int(mode.tuning.get(NUM_DRAWS, mode.z.shape[1:])[0])
                values = {"ess": size, "kind": kind, "limit": MIN_ESS, "taken": taken}
                yield Finding("few-effective-draws", values, about)
        if mode.apart > MAX_APART:
            yield Finding("runs-disagree", {"rhat": mode.apart}, about)
        if entry["divergences"] > MAX_DIVERGING * draws:
            values = {"diverging": entry["divergences"], "draws": draws}
            yield Finding("divergences", values, about)
    # With known errors, the residuals tell whether a search of all spins has missed the answer.
    complete = isinstance(posterior.searched, Coverage) and posterior.data.has_error
    alone = not complete and posterior.modes[0].solution.hits < 2
    if isinstance(posterior.searched, Repeats):
        values = {"searches": posterior.searched.searches}
        if posterior.searched.undetermined:
            values["different"] = posterior.searched.different
            yield Finding("motion-undetermined", values)
        elif posterior.searched.agree < AGREE:
            yield Finding("search-not-repeated", values)
    elif posterior.n_starts > 1 and alone:
        yield Finding("best-solution-once", {"starts": posterior.n_starts})
    if not misfit.explained:
        yield Finding("data-not-explained", {"why": why(misfit)})
