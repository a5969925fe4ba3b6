"""The reasons for which results of this room must not be trusted: codes and their texts."""

from __future__ import annotations

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
