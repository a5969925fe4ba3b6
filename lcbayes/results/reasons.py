"""The sentence for each code of a reason not to trust a fit, a comparison, a scan or a batch."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from lcbayes.core.reasons import Finding, Reason

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


def agreement(weights: Sequence[float]) -> str:
    """The first sentence about a trusted fit, from the weights of its solutions."""
    if len(weights) == 1:
        return "One solution explains the data; the chains agree on it."
    if max(weights) > 0.99:
        return "One solution holds nearly all the weight; the chains of each agree."
    return f"{len(weights)} solutions explain the data; the chains of each agree."
