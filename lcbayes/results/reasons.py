"""The sentence for each code of a reason not to trust a fit, a comparison, a scan or a batch."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from lcbayes.core.reasons import Finding, Reason

if TYPE_CHECKING:
    from lcbayes.inference.goodness_of_fit import Misfit
    from lcbayes.inference.misfit_tests import Explanation, ResidualTest

SENTENCES = {
    # chains
    "published-sampler": "the published sampler is biased by an amount that no diagnostic shows",
    "chains-disagree": "the chains disagree (R-hat {rhat:.3f}, at most {limit} is trusted): they "
    "have not found one common distribution",
    "few-effective-draws": "the draws are worth only {ess:.0f} independent ones ({kind}; at least "
    "{limit:.0f} are needed): take more with --num-samples",
    "runs-disagree": "independent runs into it disagree (R-hat {rhat:.2f} between them): each saw "
    "only a part of it",
    "divergences": "{diverging} of {draws} trajectories diverged: parts of the posterior were not "
    "reached",
    "weight-uncertain": "its weight is uncertain (evidence ± {se:.1f} nats)",
    # search
    "best-solution-once": "only one of {starts} starts of the search ended at the best solution: "
    "there may be better ones; search longer with --num-starts",
    "solutions-not-sampled": "{number} not sampled, which may hold {percent:.0f} % of the "
    "posterior: raise --max-modes",
    # particles
    "particles-moved-little": "{progress:.0%} of the way to the posterior the particles moved "
    "{moved:.0%} of what independent ones would in {moves} moves",
    "evidence-differs": "the evidence of the tempering path differs by {nats:.1f} nats from that "
    "of bridge sampling: increase the number of particles",
    "solution-found-by-few-runs": "only {found} of {runs} runs found solution {solution}: take "
    "more particles with --num-samples",
    "weights-differ": "independent runs give solution {solution} weights from {low:.2f} to "
    "{high:.2f}: take more particles with --num-samples",
    # data
    "data-not-explained": "the model does not explain the data: {why}",
    # numbers of facets
    "number-not-followed": "{why}",
    "particles-lost": "{facets} facets: the particles missed the posterior: they fit {nats:.0f} "
    "nats worse than with {fewer}; increase --num-particles",
    "probability-uncertain": "independent runs differ too much: the probability of {facets} may be "
    "anything from {low} to {high}; take more particles with --num-particles, or more runs with "
    "--num-runs",
    "points-overcounted": "each point was counted as {used:.2g} independent ones, after the best "
    "fit of the search, but the particles found a better one whose residuals are worth "
    "{found:.2g}: search longer with --num-starts",
    "sparse-path-astray": "the sparse path from {start} went astray: its best particle fits by "
    "{nats:.0f} nats worse than that of {best}; take more particles with --num-particles",
    "no-number-explains-data": "{facets} do not explain the data, and no other number tried is "
    "more probable: {why}",
    # scans
    "no-hypothesis-explains-data": "{misfit}: none of the hypotheses explains the light curve{to}",
    "too-many-parameters": "{fitted} numbers were fitted to {points} points: other attitudes would "
    "do as well",
    "fit-too-close": "chi2 is {ratio:.2f} per degree of freedom: the errors are too large, or the "
    "body follows the noise",
    "period-not-unique": "the period is not unique: {others}",
    "pole-not-unique": "the pole is not unique beyond its mirror: {others}",
    "attitude-not-unique": "the attitude is not unique: {others}",
    "period-at-end-of-range": "the best period lies {where}: widen it",
    "best-hypothesis-once": "fewer than two starts came to the best solution: there may be a "
    "better one; raise --n-poles",
    # batches
    "objects-failed": "{count} of {objects} objects failed: {names}",
    "objects-not-trusted": "{count} of {objects} results must not be trusted: {names}",
    "objects-not-done": "{count} of {objects} objects were not done",
}


def reason(finding: Finding) -> Reason:
    """The reason with its sentence."""
    about = f"{finding.about}: " if finding.about else ""
    return Reason(finding.code, about + SENTENCES[finding.code].format(**finding.values))


def reasons(findings: Iterable[Finding]) -> list[Reason]:
    """The reasons in the order of the findings, without duplicates."""
    return list(dict.fromkeys(map(reason, findings)))


def stored(content: Mapping[str, Any]) -> list[Reason]:
    """The reasons in the content of a ``summary.json``."""
    return [Reason(str(r["code"]), str(r["text"])) for r in content["reasons"]]


CAUSES = {
    "zero-point": "{about} is {size} mag {fainter} than the model",
    "phase-slope": "the brightness changes by {size} mag/rad {more} with the phase angle than the "
    "model",
    "clock": "the times of {about} are {size} s too {late}",
    "rate-drift": "the rate of rotation {grows} by {size} % over the light curve",
    "nutation": "the body precesses: its axis moves by {size} deg, at {version}",
    "lobe": "{about} has a weak lobe of {version}, {size} times as bright at its peak as the "
    "diffuse reflection",
    "facet": "there is a further facet of albedo-area {size}, about {version}",
}
TESTS = {
    "chi2": "chi2",
    "site": "the mean residuals of the sites",
    "pass": "the mean residuals of the passes",
    "phase angle": "the residuals against the phase angle",
    "rotational phase": "the residuals against the rotational phase",
    "autocorrelation": "the autocorrelation of the residuals",
    "periodogram": "the periodogram of the residuals",
}


def cause(explanation: Explanation) -> str:
    """An alternative that explains a misfit, in words."""
    amount, sd = explanation.amount, explanation.sd
    digits = max(0, 1 - int(np.floor(np.log10(sd)))) if 0 < sd < np.inf else 3
    return CAUSES[explanation.name].format(
        about=explanation.about or "a site",
        version=explanation.version,
        size=f"{abs(amount):.{digits}f} ± {sd:.{digits}f}",
        fainter="fainter" if amount > 0 else "brighter",
        more="more" if amount > 0 else "less",
        # the amount is what is to be added to the times
        late="early" if amount > 0 else "late",
        grows="grows" if amount > 0 else "falls",
    )


def why(misfit: Misfit) -> str:
    """Why the model does not explain the data, and what would."""
    found = misfit.examination
    if found is None or misfit.chi2 is None or not found.refused:
        return misfit.words
    worst = found.refused[0]
    chi2 = next(t for t in found.tests if t.name == "chi2")
    said = f"chi2 is {misfit.chi2:.0f} for {misfit.dof:g} degrees of freedom (p = {_p(chi2)})"
    if chi2.p_value >= found.limit:
        name = TESTS.get(worst.name, f"the test of {worst.name}")
        said += f", but p = {_p(worst)} for {name} (limit {found.limit:.2g})"
    if found.cause is not None:
        gain = f"which lowers chi2 by {found.cause.gain:.0f}"
        return f"{said}; a possible explanation: {cause(found.cause)}, {gain}"
    factor = np.sqrt(misfit.chi2 / misfit.dof)
    if chi2.p_value < found.limit:
        said += f"; a possible explanation: the errors are {factor:.2g} times too small"
    return f"{said}; or try more facets, or another law"


def _p(test: ResidualTest) -> str:
    return f"{test.p_value:.1g}"


def agreement(weights: Sequence[float], tested: bool = True) -> str:
    """The first sentence about a trusted fit.

    Parameters
    ----------
    weights : weights of its solutions
    tested : whether the errors of the data are known, so that the misfit could be tested
    """
    if len(weights) == 1:
        if not tested:
            return (
                "One solution fits the data; the chains agree on it. Its misfit is not tested, "
                "because the noise is inferred."
            )
        return "One solution explains the data; the chains agree on it."
    if max(weights) > 0.99:
        return "One solution holds nearly all the weight; the chains of each agree."
    verb = "explain" if tested else "fit"
    return f"{len(weights)} solutions {verb} the data; the chains of each agree."


FAULTS = {
    "clock_0.1_s": "a clock error of 0.1 s",
    "zero_point_0.03_mag": "0.03 mag between sites or nights",
    "rate_drift_1_percent": "a rate drift of 1 %",
    "errors_1.4_times": "errors 1.4 times as large",
    "site_100_m": "100 m of site position",
    "elements_1_day": "elements one day older",
}
LEAST_SHIFT = 0.05  # sd; smaller shifts are not mentioned


def rests_on(moved: Mapping[str, Mapping[str, float]]) -> list[str]:
    """A line on how far the quantity that moves most would move under each fault."""
    parts = []
    for fault, shifts in moved.items():
        name = max(shifts, key=lambda k: shifts[k], default=None)
        if name is None or fault not in FAULTS or shifts[name] < LEAST_SHIFT:
            continue
        verb = "would widen" if fault.startswith("errors") else "would move"
        parts.append(f"{FAULTS[fault]} {verb} {name} by {shifts[name]:.2g} sd")
    return [f"what the result rests on: {'; '.join(parts)}"] if parts else []
