"""Reasons why results of this package are unreliable: codes and texts."""

from __future__ import annotations

from collections.abc import Iterable

from lcbayes.core.reasons import Reason


def no_period(false_alarm: float, level: float) -> Reason:
    return Reason(
        "no-period",
        f"no period is seen: noise has a peak as high with probability {false_alarm:.2g}, and "
        f"{level:g} is asked for",
    )


def too_few_cycles(cycles: float, period: float, least: float) -> Reason:
    return Reason(
        "too-few-cycles",
        f"the spin is not rapid enough: the longest pass holds {cycles:.1f} cycles of the period "
        f"of the brightness, {period:.4g} s, and {least:g} are needed to measure it within a pass",
    )


def not_repeating(period: float, skill: float, least: float) -> Reason:
    return Reason(
        "not-repeating",
        f"the brightness does not repeat steadily: with {period:.4g} s a stretch predicts "
        f"{100 * max(skill, 0.0):.0f} % of the variance of the next, and {100 * least:.0f} % are "
        "asked for",
    )


def second_period(other: float, period: float, part: float) -> Reason:
    return Reason(
        "second-period",
        f"the spin is not stable: a line at {other:.4g} s, no harmonic of {period:.4g} s, has "
        f"{100 * part:.0f} % of the variance, as when a body tumbles",
    )


def unsteady_harmonics() -> Reason:
    return Reason(
        "unsteady-harmonics",
        "no harmonic keeps an amplitude of five times its error all along a pass, so the period "
        "cannot be followed within one",
    )


def constant_synodic_period(p_value: float) -> Reason:
    return Reason(
        "constant-synodic-period",
        "the synodic period does not measurably differ from the sidereal one: one constant period "
        f"explains all passes (p = {p_value:.2g})",
    )


def no_constant_spin(chi2: float, freedom: int) -> Reason:
    return Reason(
        "no-constant-spin",
        f"no constant spin explains the phases: chi2 is {chi2:.0f} for {freedom} degrees of "
        "freedom; the spin changes, or the axis moves",
    )


def pole_undetermined(area: float, most: float) -> Reason:
    return Reason(
        "pole-undetermined",
        "the difference between synodic and sidereal period does not determine the pole: its 90 % "
        f"region is {100 * area:.0f} % of the sky, and at most {100 * most:.0f} % is accepted; add "
        "passes of other geometry",
    )


def too_few_passes(count: int, least: int) -> Reason:
    return Reason(
        "too-few-passes",
        f"{count} pass(es) show steady harmonics, and {least} are needed: with fewer the shape of "
        "the body cannot be separated from its pole",
    )


def ambiguous_period(shortest: float, longest: float, probability: float, least: float) -> Reason:
    return Reason(
        "ambiguous-period",
        f"the sidereal period is ambiguous: the solutions have periods from {shortest:.4g} to "
        f"{longest:.4g} s, as the number of brightness cycles per turn is not determined (the "
        f"likeliest has probability {probability:.2f}, and {least:g} is asked for)",
    )


def many_poles(count: int, most: int) -> Reason:
    return Reason(
        "many-poles",
        f"{count} separate poles explain the phases, and at most {most} are accepted as an answer; "
        "add passes of other geometry",
    )


def convex_body(materials: str, lambertian: bool) -> tuple[str, str]:
    """Assumptions of an albedo-area distribution, and a hint if another law may fit better."""
    other = ""
    if lambertian:
        other = "; another law may (--material non-lambertian, the one that fit takes by default)"
    return f"no convex body of material {materials} with this attitude", other


def misfit(reduced: float, p_value: float, body: tuple[str, str]) -> Reason:
    return Reason(
        "misfit",
        f"chi2 is {reduced:.2f} per degree of freedom (p = {p_value:.1g}): {body[0]} gives this "
        f"light curve to its errors{body[1]}; the errors are too small, the body shades itself, or "
        "law or attitude differ",
    )


def large_residuals(rms: float, body: tuple[str, str]) -> Reason:
    return Reason(
        "large-residuals",
        f"residuals are {100 * rms:.0f} % of the mean flux: {body[0]} gives this light "
        f"curve{body[1]}",
    )


def residuals_follow_geometry(p_value: float) -> Reason:
    return Reason(
        "residuals-follow-geometry",
        f"residuals depend on the directions to Sun and observer (p = {p_value:.1g}): the body "
        "shades itself or is not convex, or its law or attitude differs, and facets may stand for "
        "that",
    )


def insignificant_facets(areas: Iterable[float]) -> Reason:
    sizes = ", ".join(f"{a:.3g}" for a in sorted(areas))
    return Reason(
        "insignificant-facets",
        f"facets of {sizes} m2 lower chi2 by less than they cost once errors are scaled to the "
        "misfit: they may not exist",
    )


def too_many_parameters(used: int, points: int) -> Reason:
    return Reason(
        "too-many-parameters",
        f"{used} numbers were fitted to {points} points: other facets would do as well",
    )


def areas_undetermined(count: int, total: int, limit: float) -> Reason:
    return Reason(
        "areas-undetermined",
        f"the flux does not constrain the areas of {count} of {total} facets: their standard "
        f"deviations exceed {100 * limit:.0f} %",
    )


def not_closed(changed: float) -> Reason:
    return Reason(
        "not-closed",
        f"areas had to be changed by {100 * changed:.0f} % of their sum to close: albedos differ, "
        "or facets are missing, and the shape is not the body's",
    )


def unseen_part(unseen: float) -> str:
    return f"{100 * unseen:.0f} % of all directions were never lit and seen at once"


def directions_unseen(unseen: float) -> Reason:
    return Reason(
        "directions-unseen",
        f"{unseen_part(unseen)}: what faces there is unknown, and the shape with it",
    )


def too_few_pairs(pairs: int, points: int, separation_deg: float) -> Reason:
    return Reason(
        "too-few-pairs",
        f"has not {pairs} pairs among {points} measurements within {separation_deg:g} deg of each "
        "other that were not taken one after the other; observe more passes under like geometry",
    )


def no_power() -> Reason:
    return Reason(
        "no-power",
        "has pairs, but brightness changes so fast along passes that unrelated brightness would "
        "pass as well: the body may spin, and no law of this kind can be tested",
    )


def no_law_tested(count: int, total: int, each: Reason) -> Reason:
    return Reason(each.code, f"no law could be tested; {count} of {total}: each {each.text}")


def too_few_independent(count: int, least: int) -> Reason:
    return Reason(
        "too-few-independent-points",
        f"{count} observations are independent of each other, and {least} are needed: brightness "
        "follows itself from point to point; observe more passes",
    )


def narrow_phase_angles(span: float, least: float) -> Reason:
    return Reason(
        "narrow-phase-angles",
        f"phase angles span {span:.0f} deg (5 to 95 %), and {least:g} deg are needed",
    )


def stabilised(law: str, p_value: float, ratio: float) -> Reason:
    return Reason(
        "stabilised",
        f"the object looks stabilised: where the law {law!r} repeats the directions, brightness "
        f"repeats itself (p = {p_value:.3f}, differences {100 * ratio:.0f} % of those between "
        "points at random), so that orientations are not random",
    )


def no_glint(alarm: float) -> Reason:
    return Reason(
        "no-glint",
        f"no glint stands out: none has a false-alarm probability below {alarm:g}",
    )


def no_direction(count: int) -> Reason:
    if count == 1:
        return Reason(
            "one-glint", "one glint alone fixes no direction: nothing tests that it is a facet's"
        )
    return Reason(
        "no-common-direction",
        f"{count} glint(s) fix no direction: no two share a facet's normal and no axis is "
        "perpendicular to all bisectors; the attitude may be another one",
    )


def one_glint_no_offset() -> Reason:
    return Reason(
        "one-glint", "one glint alone fixes no offset: nothing tests that a panel makes it"
    )


def no_common_offset(chi2: float, freedom: int) -> Reason:
    return Reason(
        "no-common-offset",
        f"the glints share no offset from the Sun: chi2 is {chi2:.1f} for {freedom} degrees of "
        "freedom",
    )


def no_edge(p_value: float) -> Reason:
    return Reason(
        "no-edge",
        f"no edge of a facet is seen: noise on a smooth curve does as well with p = {p_value:.3f}",
    )


def narrow_sweep(sweep: float, least: float) -> Reason:
    return Reason(
        "narrow-sweep",
        f"the direction to the observer turns by {sweep:.1f} deg in the body's axes, and "
        f"{least:g} deg are needed: the method is for passes of low orbits",
    )


def one_facet_misfit(chi2: float, dof: int) -> Reason:
    return Reason(
        "misfit",
        f"one facet over a smooth rest does not explain the curve (chi2 {chi2:.0f} for {dof} "
        "degrees of freedom): more than one facet changes, or the law is wrong",
    )


def small_share(share: float) -> Reason:
    return Reason(
        "small-share",
        f"the facet sends {share:.1%} of the light at most, and the rest of the body need not be "
        "as smooth as that",
    )


def normal_unconstrained(part: float) -> Reason:
    return Reason(
        "normal-unconstrained",
        f"the normal is not constrained: the region is {part:.0%} of the sphere",
    )


def always_seen(probability: float) -> Reason:
    return Reason(
        "always-seen",
        f"with {probability:.0%} probability the facet is lit and seen throughout, and what it "
        "looks like is the smooth rest's to decide",
    )
