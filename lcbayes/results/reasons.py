"""The sentence for each code of a reason not to trust a result, and for conditions of a spin."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from lcbayes.core.reasons import Finding, Reason
from lcbayes.core.text import join_words
from lcbayes.geometry.spherical import lon_lat_deg

if TYPE_CHECKING:
    from lcbayes.inference.goodness_of_fit import Misfit
    from lcbayes.inference.misfit_tests import Explanation

MOST_SPINS = 12  # listed in the text

SENTENCES = {
    # chains
    "published-sampler": "the published sampler is biased by an amount that no diagnostic shows",
    "chains-disagree": "the chains disagree (R-hat {rhat:.4f}, at most {limit} is trusted): they "
    "have not found one common distribution{agree}",
    "few-effective-draws": "the draws are worth only {ess:.0f} independent ones ({kind}; at least "
    "{limit:.0f} are needed): take more than {taken} in a chain with --num-samples",
    "runs-disagree": "independent runs into it disagree (R-hat {rhat:.2f} between them): each saw "
    "only a part of it",
    "divergences": "{diverging} of {draws} trajectories diverged: parts of the posterior were not "
    "reached",
    "weight-uncertain": "its weight is uncertain (evidence ± {se:.1f} nats)",
    # search
    "best-solution-once": "only one of {starts} starts of the search ended at the best solution: "
    "there may be better ones; search longer with --num-starts",
    "search-not-repeated": "only one of {searches} independent searches ended at the best "
    "solution: there may be better ones; search longer with --num-starts",
    "motion-undetermined": "the data do not determine the motion: {searches} independent searches "
    "ended at {different} motions that explain them nearly equally well; observe another pass",
    "solutions-not-sampled": "{number} not sampled, which may hold {percent:.0f} % of the "
    "posterior: raise --max-modes",
    "spin-undetermined": "the data do not determine the spin: {number} solutions explain them, "
    "with periods from {shortest_s:.5g} to {longest_s:.5g} s and {axes}, and those not sampled may "
    "hold {percent:.0f} % of the posterior; observe another pass, or raise --max-modes",
    "period-of-scan": "the period is that of the scan, which must not be trusted: {why}",
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
    "drift-or-late-pass": "the phases do not tell a drift of the rate from late times of a pass, "
    "and the period depends on it: it is {period_s:#.7g} s if the rate drifts, as in the result, "
    "but the rate may be constant, with {passes}; observe another pass, or give --clock-sd if the "
    "times are certain",
    "curve-appears-late": "the residuals say that {late}; that moves {what} by {shift:.2g} "
    "standard deviations: correct these times, or leave the curve out",
    "another-body": "a {body} explains the data about as well or better (ln evidence "
    "{log_odds:+.1f}) with another spin, {motion}: averaged over both bodies, the {nominal:.0f} % "
    "interval of {what} holds {percent:.0f} %; fit it with --model {model}",
    "shadows-left-out": "the parts of the body shade one another, and the fit leaves that out: "
    "their shadows take {percent:.2g} % of the light, which moves {what} by {shift:.2g} standard "
    "deviations; set shadows = true in the body's file, where lengths of parts must be numbers",
    # numbers of facets
    "number-not-followed": "{why}",
    "evidence-doubtful": "the evidence is uncertain: {why}",
    "particles-lost": "{facets} facets: the particles missed the posterior: they fit {nats:.0f} "
    "nats worse than with {fewer}; increase --num-particles",
    "probability-uncertain": "independent runs differ too much: the probability of {facets} may be "
    "anything from {low} to {high}; take more runs with --num-runs, or, for evidences from "
    "particles, more of these with --num-particles",
    "points-overcounted": "each point was counted as {used:.2g} independent ones, after the best "
    "fit of the search, but the particles found a better one whose residuals are worth "
    "{found:.2g}: search longer with --num-starts",
    "no-number-explains-data": "{facets} do not explain the data, and no other number tried is "
    "more probable: {why}",
    # scans
    "no-hypothesis-explains-data": "{misfit}: none of the hypotheses explains the light curve{to}",
    "too-many-parameters": "{fitted} numbers were fitted to {points} points: other {others} would "
    "do as well",
    "fit-too-close": "chi2 is {ratio:.2f} per degree of freedom: the errors are too large, or the "
    "body follows the noise",
    "period-not-unique": "the period is not unique: {others}",
    "curve-contradicts": "{curve} contradicts the others: {others}; check its times, or leave it "
    "out",
    "pole-not-unique": "the pole is not unique beyond its mirror: {others}",
    "pole-not-calibrated": "the probability of the pole is not shown to be right: of 36 poles of "
    "simulated bodies with 0.99 or more, 36 were right, too few to trust such a one",
    "attitude-not-unique": "the attitude is not unique: {others}",
    "period-at-end-of-range": "the best period lies {where}: widen it",
    "best-hypothesis-once": "fewer than two starts came to the best solution: there may be a "
    "better one; raise --n-poles",
    # spins
    "no-period": "no period is seen: noise has a peak as high with probability {false_alarm:.2g}, "
    "and {level:g} is asked for",
    "too-few-cycles": "the spin is not rapid enough: the longest pass holds {cycles:.1f} cycles of "
    "the period of the brightness, {period_s:.4g} s, and {least:g} are needed to measure it within "
    "a pass",
    "not-repeating": "the brightness does not repeat steadily: with {period_s:.4g} s a stretch "
    "predicts {percent:.0f} % of the variance of the next, and {least:.0f} % are asked for",
    "second-period": "the spin is not stable: a line at {other_s:.4g} s, no harmonic of "
    "{period_s:.4g} s, has {percent:.0f} % of the variance, as when a body tumbles",
    "unsteady-harmonics": "no harmonic keeps an amplitude of five times its error all along a "
    "pass, so the period cannot be followed within one",
    "constant-synodic-period": "the synodic period does not measurably differ from the sidereal "
    "one: one constant period explains all passes (p = {p_value:.2g})",
    "no-constant-spin": "no constant spin explains the phases: chi2 is {chi2:.0f} for {dof} "
    "degrees of freedom; the spin changes, or the axis moves",
    "too-few-passes": "{count} pass(es) show steady harmonics, and {least} are needed: with fewer "
    "the shape of the body cannot be separated from its pole",
    "pole-undetermined": "the difference between synodic and sidereal period does not determine "
    "the pole: its 90 % region is {percent:.0f} % of the sky, and at most {most:.0f} % is "
    "accepted; add passes of other geometry",
    "ambiguous-period": "the sidereal period is ambiguous: the solutions have periods from "
    "{shortest_s:.4g} to {longest_s:.4g} s, as the number of brightness cycles per turn is not "
    "determined (the likeliest has probability {probability:.2f}, and {least:g} is asked for)",
    "many-poles": "{count} separate poles explain the phases, and at most {most} are accepted as "
    "an answer; add passes of other geometry",
    # albedo-areas
    "misfit": "chi2 is {ratio:.2f} per degree of freedom (p = {p_value:.1g}): no convex body of "
    "material {materials} with this attitude gives this light curve to its errors{remedy}; the "
    "errors are too small, the body shades itself, or law or attitude differ",
    "large-residuals": "residuals are {percent:.0f} % of the mean flux: no convex body of material "
    "{materials} with this attitude gives this light curve{remedy}",
    "residuals-follow-geometry": "residuals depend on the directions to Sun and observer "
    "(p = {p_value:.1g}): the body shades itself or is not convex, or its law or attitude differs, "
    "and facets may stand for that",
    "insignificant-facets": "facets of {areas} m2 lower chi2 by less than they cost once errors "
    "are scaled to the misfit: they may not exist",
    "areas-undetermined": "the flux does not constrain the areas of {count} of {facets} facets: "
    "their standard deviations exceed {percent:.0f} %",
    "not-closed": "areas had to be changed by {percent:.0f} % of their sum to close: albedos "
    "differ, or facets are missing, and the shape is not the body's",
    "directions-unseen": "{percent:.0f} % of all directions were never lit and seen at once: what "
    "faces there is unknown, and the shape with it",
    # tests of attitudes
    "too-few-pairs": "no law could be tested; {count} of {laws}: each has fewer than {pairs} pairs "
    "among {points} measurements within {separation_deg:g} deg of each other that were not taken "
    "one after the other; observe more passes under like geometry",
    "no-power": "no law could be tested; {count} of {laws}: each has pairs, but brightness changes "
    "so fast along passes that unrelated brightness would pass as well: the body may spin, and no "
    "law of this kind can be tested",
    "law-not-applicable": "no law could be tested; {count} of {laws}: each {why}",
    # shape matches
    "too-few-independent-points": "{count} observations are independent of each other, and {least} "
    "are needed: brightness follows itself from point to point; observe more passes",
    "narrow-phase-angles": "phase angles span {span_deg:.0f} deg (5 to 95 %), and {least_deg:g} "
    "deg are needed",
    "stabilised": "the object looks stabilised: where the law {law!r} repeats the directions, "
    "brightness repeats itself (p = {p_value:.3f}, differences {percent:.0f} % of those between "
    "points at random), so that orientations are not random",
    # glints
    "no-glint": "no glint stands out: none has a false-alarm probability below {alarm:g}",
    "one-glint": "one glint alone fixes no direction: nothing tests that it is a facet's",
    "no-common-direction": "{count} glint(s) fix no direction: no two share a facet's normal and "
    "no axis is perpendicular to all bisectors; the attitude may be another one",
    "one-glint-no-offset": "one glint alone fixes no offset: nothing tests that a panel makes it",
    "no-common-offset": "the glints share no offset from the Sun: chi2 is {chi2:.1f} for {dof} "
    "degrees of freedom",
    # single facets
    "no-edge": "no edge of a facet is seen: noise on a smooth curve does as well with "
    "p = {p_value:.3f}",
    "narrow-sweep": "the direction to the observer turns by {sweep_deg:.1f} deg in the body's "
    "axes, and {least_deg:g} deg are needed: the method is for passes of low orbits",
    "one-facet-misfit": "one facet over a smooth rest does not explain the curve (chi2 {chi2:.0f} "
    "for {dof} degrees of freedom): more than one facet changes, or the law is wrong",
    "small-share": "the facet sends {share:.1%} of the light at most, and the rest of the body "
    "need not be as smooth as that",
    "normal-unconstrained": "the normal is not constrained: the region is {part:.0%} of the sphere",
    "always-seen": "with {probability:.0%} probability the facet is lit and seen throughout, and "
    "what it looks like is the smooth rest's to decide",
    # occultations
    "chords-choose-few-bodies": "the chords choose {effective:.1f} of {bodies} bodies of the "
    "posterior (effective number; at least {limit:.0f} are needed): no diameter or weight is given "
    "from light curves and chords together; take more with --num-bodies, or fit a more flexible "
    "body",
    # batches
    "objects-failed": "{count} of {objects} objects failed: {names}",
    "objects-not-trusted": "{count} of {objects} results must not be trusted: {names}",
    "objects-not-done": "{count} of {objects} objects were not done",
}

# Conditions of a spin that are met, by the code of the reason if they are not.
CONDITIONS = {
    "no-period": "a period is seen (false-alarm probability {false_alarm:.2g})",
    "too-few-cycles": "the longest pass has {cycles:.1f} cycles",
    "not-repeating": "a stretch predicts {percent:.0f} % of the variance of the next",
    "second-period": "no second period",
    "unsteady-harmonics": "harmonics are steady and strong enough",
    "constant-synodic-period": "the synodic period varies (p = {p_value:.1g} for a constant one)",
    "no-constant-spin": "a pole explains the phases (chi2 {chi2:.1f} for {dof} degrees of freedom)",
    "too-few-passes": "{count} passes show steady harmonics",
    "pole-undetermined": "the pole lies within {percent:.2g} % of the sky",
    "ambiguous-period": "the number of cycles per turn has probability {probability:.2f}",
    "many-poles": "{count} pole(s)",
}

SPIN_AGREES = "; only its rate and axis of rotation agree (R-hat {rhat:.3f})"

# What to try, by the value "remedy" of a finding.
REMEDIES = {
    "": "",
    "another-law": "; another law may (--material non-lambertian, the one that fit takes by "
    "default)",
}


def condition(finding: Finding, *, met: bool) -> str:
    """The sentence about a condition of a spin, with the values of its finding."""
    return (CONDITIONS if met else SENTENCES)[finding.code].format(**finding.values)


def reason(finding: Finding) -> Reason:
    """The reason with its sentence."""
    about = f"{finding.about}: " if finding.about else ""
    values = finding.values | {"remedy": REMEDIES[finding.values.get("remedy", "")]}
    spin = finding.values.get("spin")
    values["agree"] = "" if spin is None else SPIN_AGREES.format(rhat=spin)
    return Reason(finding.code, about + SENTENCES[finding.code].format(**values))


def reasons(findings: Iterable[Finding]) -> list[Reason]:
    """The reasons in the order of the findings, one for all findings of one kind.

    If they concern several parts of the result, the sentence has the numbers of the first and names
    the others.
    """
    kinds: dict[tuple[str, ...], dict[str, Finding]] = {}
    for finding in findings:
        kind = str(finding.values.get("kind", "")) if finding.about else repr(finding)
        kinds.setdefault((finding.code, kind), {}).setdefault(finding.about, finding)
    return [_joined(*kind.values()) for kind in kinds.values()]


def _joined(first: Finding, *others: Finding) -> Reason:
    one = reason(first)
    if not others:
        return one
    noun = first.about.rpartition(" ")[0]
    numbers = [other.about.removeprefix(f"{noun} ") for other in others]
    plural = "s" if len(others) > 1 else ""
    return Reason(one.code, f"{one.text}; likewise {noun}{plural} {join_words(numbers)}")


def stored(content: Mapping[str, Any]) -> list[Reason]:
    """The reasons in the content of a ``summary.json``."""
    return [Reason(str(r["code"]), str(r["text"])) for r in content["reasons"]]


LEAST_SHARE = 0.5  # of the excess of chi2 that an alternative explains
CAUSES = {
    "zero-point": "{about} is {size} mag {fainter} than the model",
    "phase-slope": "the brightness changes by {size} mag/rad {more} with the phase angle than the "
    "model",
    "pass-slope": "the brightness of {about} changes by {size} mag (rms) from the middle of a pass "
    "to its end beyond the model, as by extinction",
    "clock": "the times of {about} are {size} s too {late}",
    "late-pass": "the times of {about} are {size} s too {late}",
    "late-curve": "the times of {version} are {size} min too {late}",
    "faint-apparition": "{version} is {size} mag {fainter} than in other apparitions: make it a "
    "curve of its own",
    "rate-drift": "the rate of rotation {grows} by {size} % over the light curve",
    "nutation": "the body nutates by {size} deg (rms), at {version}: give nutation_ratio",
    "lobe": "{about} has a weak lobe of {version}, {size} times as bright at its peak as the "
    "diffuse reflection",
    "shadows": "the parts of the body shade one another (amount {size}, where 1 is all of it): set "
    "shadows = true in the body's file",
    "notch": "the body shades itself: {version} stand on one another, which no convex body has",
    "facet": "there is a further facet of albedo-area {size}, about {version}",
    "law": "the surface scatters in part by {version} (share {size}, where 1 is all of it)",
}
TESTS = {
    "chi2": "χ²",
    "site": "the mean residuals of the sites",
    "pass": "the mean residuals of the passes",
    "apparition": "the mean residuals of the apparitions",
    "phase angle": "the residuals against the phase angle",
    "rotational phase": "the residuals against the rotational phase",
    "autocorrelation": "the autocorrelation of the residuals",
    "periodogram": "the periodogram of the residuals",
    "zero-point": "the zero point of {about}",
    "phase-slope": "a further slope with the phase angle",
    "pass-slope": "a slope of {about} along each pass",
    "clock": "the clock of {about}",
    "late-pass": "the clock in {about}",
    "late-curve": "the times of one curve",
    "faint-apparition": "the zero point of one apparition",
    "rate-drift": "a drift of the rate of rotation",
    "nutation": "nutation",
    "lobe": "a weak lobe of {about}",
    "shadows": "shadows between the parts of the body",
    "notch": "two facets that shade one another",
    "facet": "a further facet",
    "law": "another law of diffuse reflection",
}


def name_of_test(name: str) -> str:
    """A test of the residuals in words, from its code and the part that it concerns."""
    if name in TESTS:
        return TESTS[name]
    code, _, about = name.partition(" ")
    return TESTS[code].format(about=about) if code in TESTS else name


def cause(explanation: Explanation | SimpleNamespace) -> str:
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
    examination = misfit.examination
    if examination is None or misfit.chi2 is None or not examination.refused:
        return misfit.words
    worst = examination.refused[0]
    chi2 = next(t for t in examination.tests if t.name == "chi2")
    p = p_words(chi2.p_value, chi2.upper_limit)
    said = f"chi2 is {misfit.chi2:.0f} for {misfit.dof:g} degrees of freedom (p {p})"
    if chi2.p_value >= examination.limit:
        said += (
            f", but p {p_words(worst.p_value, worst.upper_limit)} for {name_of_test(worst.name)} "
            f"(limit {examination.limit:.2g})"
        )
    errors = chi2.p_value < examination.limit
    excess = misfit.chi2 - misfit.dof
    if examination.cause is not None and not (
        errors and examination.cause.gain < LEAST_SHARE * excess
    ):
        guess = "a possible explanation"
        if examination.cause.rough:
            guess = "a rough guess, because the amount is too large for this linear estimate"
        gain = f"which lowers chi2 by {examination.cause.gain:.0f}"
        return f"{said}; {guess}: {cause(examination.cause)}, {gain}"
    if examination.kurtosis is not None and misfit.law == "gaussian":
        return (
            f"{said}; a possible explanation: outliers, since the tails of the residuals are "
            f"heavier than Gaussian (kurtosis {examination.kurtosis:.1f} instead of 3): try "
            "--noise student-t"
        )
    if errors and (examination.even or examination.cause is None):
        factor = np.sqrt(misfit.chi2 / misfit.dof)
        said += f"; a possible explanation: the errors are {factor:.2g} times too small"
        evidence = (
            ", since the residuals are white and Gaussian but for this factor; if the errors are "
            "right, the law or the body differs"
        )
        return said + (evidence if examination.even else "")
    if examination.cause is not None:
        said += "; no single change of the model removes half of the excess of chi2"
    if misfit.facets:
        return f"{said}; try more facets, another law or another body"
    return f"{said}; try another law or another body, and check the times of every pass"


def p_words(p_value: float, upper_limit: bool) -> str:
    """A p-value of a simulated test, such as ``= 0.02``, or ``< 0.0003`` for a limit."""
    if not upper_limit:
        return f"= {p_value:.1g}"
    unit = 10.0 ** np.floor(np.log10(p_value))
    return f"< {np.ceil(p_value / unit) * unit:.1g}"


def agreement(weights: Sequence[float], fit: Mapping[str, Any]) -> str:
    """The first sentences about a trusted fit.

    Parameters
    ----------
    weights : weights of its solutions
    fit : ``fit`` of its ``summary.json``
    """
    tested = fit.get("chi2") is not None
    verb = "explain" if tested else "fit"
    if len(weights) == 1:
        first = f"One solution {verb}s the data; the chains agree on it."
    elif max(weights) > 0.99:
        first = "One solution holds nearly all the weight; the chains of each agree."
    else:
        first = f"{len(weights)} solutions {verb} the data; the chains of each agree."
    return first if tested else f"{first} {residual_pattern(fit)}"


def residual_pattern(fit: Mapping[str, Any]) -> str:
    """Whether the residuals of a fit with an inferred noise are more than noise."""
    tests = [one for one in fit.get("tests", ()) if one["name"] != "chi2"]
    if not tests:
        return "Its misfit is not tested, because the noise is inferred."
    worst, limit = min(tests, key=lambda one: one["p_value"]), fit["p_limit"]
    if worst["p_value"] >= limit:
        return "The size of the noise is inferred; the residuals show no pattern."
    p = p_words(worst["p_value"], worst["upper_limit"])
    said = (
        "The size of the noise is inferred; the residuals show a pattern (p "
        f"{p} for {name_of_test(worst['name'])}, limit {limit:.2g})"
    )
    named = [one for one in fit.get("alternatives", ()) if one["p_value"] < limit]
    best = max(named, key=lambda one: one["gain"], default=None)
    if best is not None:
        guess = "a rough guess" if best["rough"] else "a possible explanation"
        said += f"; {guess}: {cause(SimpleNamespace(**{'about': '', 'version': ''} | best))}"
    return f"{said}."


def searched(coverage: Mapping[str, Any] | None) -> list[str]:
    """A line on how thorough a search was.

    ``coverage`` has the attributes of `inference.spin_search.cells.Coverage` or
    `inference.tumbling_search.Repeats`.
    """
    if not coverage:
        return []
    if "searches" in coverage:
        return [
            f"{coverage['agree']} of {coverage['searches']} independent searches ended at the best "
            f"motion, from {coverage['starts']:,.0f} starts in all."
        ]
    which = f"up to {coverage['max_rate']:.3g} rad/s"
    if ranges := coverage.get("ranges"):
        listed = [f"{2 * np.pi / b:.5g} to {2 * np.pi / a:.5g} s" for a, b in reversed(ranges)]
        which = f"with periods of {' or '.join(listed)}"
    if (sky := coverage.get("sky", 1.0)) < 1.0:
        which += f" and poles in the given {100 * sky:.2g} % of the sky"
    others = ", and no others" if ranges or sky < 1.0 else ""
    return [
        f"All spins {which} were searched{others}: of "
        f"{coverage['cells']:,.0f} cells of pole and rate, {coverage['survivors']:,.0f} were "
        "followed to the end."
    ]


def other_spins(spins: Sequence[Mapping[str, Any]]) -> list[str]:
    """Lines on the spins that explain the data, if some were not sampled."""
    if all(s["sampled"] for s in spins):
        return []
    lines = ["Spins that explain the data (share of the posterior, Gaussian approximation):"]
    for s in spins[:MOST_SPINS]:
        lon, lat = lon_lat_deg(np.array(s["omega_rad_s"]))
        note = "" if s["sampled"] else ", not sampled"
        axis = f"axis {float(lon):5.1f}, {float(lat):+5.1f} deg"
        lines.append(f"  {100 * s['share']:3.0f} %  period {s['period_s']:.6g} s, {axis}{note}")
    if len(spins) > MOST_SPINS:
        lines.append(f"  … and {len(spins) - MOST_SPINS} more in summary.json")
    return lines
