"""The text of a comparison of numbers of facets: conclusion, verdict and table."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.reasons import Finding, Reason
from lcbayes.core.text import join_words
from lcbayes.inference import odds
from lcbayes.inference.facet_count import Candidate, Compared
from lcbayes.inference.loo import BAD_K, Stacked, stacking
from lcbayes.inference.odds import facets
from lcbayes.results.content import CandidateContent, CompareNumbers
from lcbayes.results.reasons import reasons

CLEANER = 1.5  # largest ratio of the best particle's information per point to the power used
ASTRAY = 10.0  # nats by which the sparse path may fit worse than the best number of facets
AREA_FACTORS = (0.2, 0.5, 1.0, 2.0, 5.0)  # of the median of the prior on areas, for the odds
SAME_MEDIAN = 0.2  # ln of a ratio of two medians, below which one of them is shown
MIN_DRAWS = 100.0  # effective draws for a change of the evidence with an error of 0.1 nat
LOST = 20.0  # nats below the best, allowing for the error, beyond which a poor run is ignored

# Columns of tables/candidates.csv and of each row of `candidates`, with their descriptions.
COLUMNS = {
    "body": "kind of body, if kinds of body were compared",
    "n_facets": "number of facets",
    "n_parameters": "number of inferred parameters",
    "log_evidence": "ln of the evidence, nat",
    "log_evidence_se": "its standard error, nat",
    "log_evidence_below": "what ln of the evidence cannot exceed, of a number ruled out, nat",
    "log_evidence_spread": "standard deviation of one run's ln evidence, nat",
    "probability": "posterior probability of the number, each number as likely before",
    "probability_q05": "5 % of what it may be, for the errors of the evidences",
    "probability_q95": "95 % of what it may be",
    "elpd_loo": "sum over epochs of ln p(epoch | the others), nat",
    "elpd_se": "its standard error, nat",
    "elpd_diff": "elpd_loo minus the best one, nat",
    "elpd_diff_se": "standard error of the difference, nat",
    "max_pareto_k": "largest Pareto k of PSIS-LOO",
    "n_bad_pareto_k": f"epochs whose Pareto k exceeds {BAD_K}",
    "stacking_weight": "weight in the mixture that predicts best",
    "chi2": "of the best fit",
    "dof": "epochs minus the parameters that they set, or epochs where less than 1 is left",
}


def summarise(
    comparison: Compared, identity: Mapping[str, Any], n_obs: int, seed: int
) -> tuple[CompareNumbers, list[Reason]]:
    """The content of ``summary.json`` besides the verdict, and the reasons against the result."""
    candidates, names = comparison.candidates, [c.name for c in comparison.candidates]
    n_runs = len(candidates[0].log_evidences)
    errors = odds.moderated(np.array([c.se for c in candidates]))
    values = np.array([c.log_evidence for c in candidates])
    chances = odds.probabilities(values, errors, n_runs, seed)
    verdict: odds.Verdict[Any]
    if comparison.weighed_body:
        verdict = odds.verdict_of_bodies(names, chances)
    else:
        verdict = odds.verdict([c.n_facets for c in candidates], chances)
    stacked = stacking({c.name: c.loo for c in candidates})
    worth = comparison.information
    rows = _rows(comparison, errors, chances, stacked)
    against = [
        *comparison.failed,
        *odds.undecided(names, chances),
        *_findings(comparison, verdict),
    ]
    content: CompareNumbers = {
        "model": identity["model"],
        "n_obs": n_obs,
        "seed": seed,
        "conclusion": verdict.sentence,
        "most_probable": verdict.best,
        "not_told_from_it": verdict.rivals,
        "not_excluded": verdict.possible,
        "information_per_point": worth,
        "weighed_at_n_facets": comparison.weighed_at,
        "n_runs": n_runs,
        "candidates": rows,
        "ruled_out": [
            {
                "n_facets": r.n_facets,
                "n_parameters": r.n_parameters,
                "log_evidence_below": r.below,
                "probability": 0.0,
                "chi2": r.misfit.chi2,
                "dof": r.misfit.dof,
            }
            for r in comparison.ruled_out
        ],
        "sparse": _sparse(comparison),
        "area_prior": _area_prior(comparison),
        "timing": {
            "search_s": comparison.search_s,
            "sampling_s": sum(c.seconds for c in candidates),
            "gradients": sum(c.gradients for c in candidates),
        },
        "identity": dict(identity),
    }
    if comparison.weighed_body:
        content["weighed_at"] = comparison.weighed_body
        for row, name in zip(rows, names, strict=True):
            row["body"] = name
    return content, reasons(against)


def _sparse(comparison: Compared) -> dict[str, Any] | None:
    """End of the sparse path and the nats by which it fits worse than the best number, or why there
    is none."""
    if comparison.path is None:
        return {"fault": comparison.path_fault} if comparison.path_fault else None
    fits = max(comparison.candidates, key=lambda c: c.best)
    behind = comparison.information * fits.best - comparison.path.best
    return asdict(comparison.path) | {"behind": behind, "astray": bool(behind > ASTRAY)}


def _area_prior(comparison: Compared) -> dict[str, Any] | None:
    """The prior on areas, and the probabilities under other medians of it."""
    prior = comparison.area_prior
    if (
        prior is None
        or comparison.weighed_body
        or not all(c.log_areas.size for c in comparison.candidates)
    ):
        return None
    medians = [float(np.exp(prior.log_mean)) * f for f in AREA_FACTORS]
    if np.min(np.abs(np.log(medians) - prior.default)) > SAME_MEDIAN:
        medians.append(float(np.exp(prior.default)))
    scan: list[dict[str, Any]] = []
    for median in sorted(medians):
        changes = [
            odds.evidence_change(c.log_areas, prior.log_mean, prior.log_sd, np.log(median))
            for c in comparison.candidates
        ]
        if min(draws for _, draws in changes) < MIN_DRAWS:
            continue
        value = np.array([c.log_evidence for c in comparison.candidates]) + [d for d, _ in changes]
        scan.append({"median_m2": float(median), "probability": odds.shares(value)})
    return {
        "median_m2": float(np.exp(prior.log_mean)),
        "log_sd": prior.log_sd,
        "from_data": prior.from_data,
        "scan": scan,
    }


def _rows(
    comparison: Compared, errors: NDArray[np.float64], chances: odds.Odds, stacked: Stacked
) -> list[CandidateContent]:
    """The candidates, with their probabilities and stacking weights."""
    worth = comparison.information
    rows: list[CandidateContent] = []
    for k, c in enumerate(comparison.candidates):
        elpd, khat = c.loo
        rows.append(
            {
                "n_facets": c.n_facets,
                "n_parameters": c.n_parameters,
                "log_evidence": c.log_evidence,
                "log_evidence_se": errors[k],
                "log_evidence_spread": c.spread,
                "log_evidences": c.log_evidences,
                "log_prior_mass": c.log_prior_mass,
                "probability": chances.probability[k],
                "probability_q05": chances.low[k],
                "probability_q95": chances.high[k],
                "elpd_loo": elpd.sum(),
                # fewer of the points are independent where consecutive points are correlated
                "elpd_se": np.sqrt(elpd.size * elpd.var() / worth),
                "elpd_diff": stacked.diff[k],
                "elpd_diff_se": stacked.diff_se[k] / np.sqrt(worth),
                "max_pareto_k": khat.max(),
                "n_bad_pareto_k": int(np.sum(khat > BAD_K)),
                "n_bounded": int(np.sum(np.isneginf(khat))),
                "stacking_weight": stacked.weight[k],
                "chi2": c.misfit.chi2,
                "dof": c.misfit.dof,
                "gradients": c.gradients,
                "seconds": c.seconds,
                "evidence_from": "chains" if c.from_chains else "particles",
                "chains_doubted": c.doubt,
                "reasons": [reason.content for reason in reasons(c.reasons)],
            }
        )
    return rows


def _findings(comparison: Compared, verdict: odds.Verdict[Any]) -> Iterator[Finding]:
    top = max(c.log_evidence for c in comparison.candidates)
    for c in comparison.candidates:
        if c.log_evidence + 5.0 * c.se > top - LOST:
            yield from (reason._replace(about=c.name) for reason in c.reasons)
    fits: Candidate = max(comparison.candidates, key=lambda c: c.best)
    if fits.information > CLEANER * comparison.information:
        worth = {"used": comparison.information, "found": fits.information}
        yield Finding("points-overcounted", worth)
    best = next(c for c in comparison.candidates if verdict.best in (c.body, c.n_facets))
    if not best.misfit.explained:
        values = {"facets": best.name, "why": best.misfit.words}
        yield Finding("no-number-explains-data", values)


PRINTED = ("ln Z (nat)", "probability", "5 % to 95 %", "LOO from best", "chi2/dof")


def cells(summary: Mapping[str, Any]) -> tuple[list[str], list[list[str]]]:
    """Heads and rows of the printed table."""
    heads = [
        "body" if of_bodies(summary) else "facets",
        "ln Z (nat)",
        "spread",
        "probability",
        "5 % to 95 %",
        "elpd LOO (nat)",
        "LOO from best",
        "stacking",
        "max k",
        f"k > {BAD_K}",
        "chi2/dof",
    ]
    rows: list[list[str]] = []
    path: Mapping[str, Any] = summary.get("sparse") or {}
    ends = path.get("n_facets")
    for row in summary["candidates"]:
        k = row["max_pareto_k"]
        rows.append(
            [
                row.get("body") or str(row["n_facets"]) + (" *" if row["n_facets"] == ends else ""),
                f"{row['log_evidence']:.2f} ± {row['log_evidence_se']:.2f}",
                f"{row['log_evidence_spread']:.2f}",
                f"{row['probability']:.3f}",
                f"{row['probability_q05']:.3f} to {row['probability_q95']:.3f}",
                f"{row['elpd_loo']:.1f} ± {row['elpd_se']:.1f}",
                f"{row['elpd_diff']:.1f} ± {row['elpd_diff_se']:.1f}",
                f"{row['stacking_weight']:.2f}",
                "–" if np.isneginf(k) else f"{k:.2f}",
                str(row["n_bad_pareto_k"]),
                _per_dof(row),
            ]
        )
    for row in summary["ruled_out"]:
        none = ["–"] * (len(heads) - 5)
        below = f"< {row['log_evidence_below']:.0f}"
        rows.append([str(row["n_facets"]), below, "–", "0", *none, _per_dof(row)])
    if of_bodies(summary):
        return heads, rows
    return heads, sorted(rows, key=lambda row: int(row[0].split()[0]))


def of_bodies(summary: Mapping[str, Any]) -> bool:
    """Whether kinds of body are compared, not only numbers of facets."""
    return any(row.get("body") for row in summary["candidates"])


def _weighed_at(summary: Mapping[str, Any]) -> str:
    return summary.get("weighed_at") or facets(summary["weighed_at_n_facets"])


def _per_dof(row: Mapping[str, Any]) -> str:
    return "–" if row["chi2"] is None else f"{row['chi2']:.0f}/{row['dof']:g}"


def notes(summary: Mapping[str, Any]) -> list[str]:
    """Notes on the table."""
    said: list[str] = []
    worth = summary["information_per_point"]
    if worth < 1.0:
        said.append(
            f"The residuals of the best fit ({_weighed_at(summary)}) follow each other: the "
            f"{summary['n_obs']} points count as {worth * summary['n_obs']:.0f}, for every "
            f"{'kind of body' if of_bodies(summary) else 'number of facets'}."
        )
    if out := [row["n_facets"] for row in summary["ruled_out"]]:
        said.append(
            f"Ruled out by the best fit alone, whose likelihood no evidence can exceed: "
            f"{join_words([*map(str, out[:-1]), facets(out[-1])])}. They were not sampled."
        )
    said += _sparse_notes(summary)
    said += _area_notes(summary)
    bad = [r for r in summary["candidates"] if r["n_bad_pareto_k"]]
    if bad:
        named = [r.get("body") or str(r["n_facets"]) for r in bad]
        if not of_bodies(summary):
            named[-1] = facets(bad[-1]["n_facets"])
        said.append(
            f"LOO of {join_words(named)} rests on epochs whose "
            f"Pareto k exceeds {BAD_K}: it may be too favourable there."
        )
    return said


def _sparse_notes(summary: Mapping[str, Any]) -> Iterator[str]:
    path = summary.get("sparse")
    if path is None:
        return
    if "fault" in path:
        yield f"There is no sparse path: {path['fault']}. It does not affect the conclusion."
        return
    shares = ", ".join(f"{n}: {s:.2f}" for n, s in path["shares"].items())
    start = facets(path["upper_bound"])
    yield (
        f"* where the sparse path from {start} ends, at the weight {path['sparsity']:.3g} /m⁴ "
        f"(shares of its optima by facets that remain: {shares})."
    )
    if path["astray"]:
        yield (
            f"The sparse path fits {path['behind']:.0f} nats worse than the best number, so its "
            "end means nothing. It does not affect the conclusion."
        )


def _area_notes(summary: Mapping[str, Any]) -> Iterator[str]:
    """How the probabilities depend on the prior on areas."""
    prior = summary.get("area_prior")
    if prior is None:
        return
    origin = "that of the best fit" if prior["from_data"] else "as given"
    numbers = [row["n_facets"] for row in summary["candidates"]]
    each: list[str] = []
    for entry in prior["scan"]:
        shown = [
            f"{n}: {p:.2f}"
            for n, p in zip(numbers, entry["probability"], strict=True)
            if p >= 0.005
        ]
        each.append(f"{entry['median_m2']:.3g} m² ({', '.join(shown)})")
    yield (
        f"The prior on the area of each facet has the median {prior['median_m2']:.3g} m², {origin},"
        f" and a factor of {np.exp(prior['log_sd']):.2g} as 1 sd. Probabilities by median: "
        f"{'; '.join(each)}."
    )


def table(summary: Mapping[str, Any]) -> list[str]:
    """The table, its notes and the conclusion, with the columns that fit on a terminal."""
    heads, rows = cells(summary)
    shown = [0, *(heads.index(name) for name in PRINTED)]
    printed = [[line[i] for i in shown] for line in (heads, *rows)]
    widths = [max(map(len, column)) for column in zip(*printed, strict=True)]
    lines = [
        "  ".join(cell.rjust(width) for cell, width in zip(line, widths, strict=True))
        for line in printed
    ]
    said = summary["conclusion"]
    return [*lines, *notes(summary), "", said[0].upper() + said[1:] + "."]
