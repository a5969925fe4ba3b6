"""Formatting of numbers, whose uncertainty determines the number of digits, and names of axes."""

from __future__ import annotations

import math

FRAMES = {
    "icrs": "ICRS (equatorial, J2000)",
    "ecliptic-j2000": "ecliptic J2000",
    "inertial": "the inertial axes of the input file",
}
SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def digits(value: float, spread: float) -> int:
    """Decimals that show two digits of ``spread`` (may be negative)."""
    if math.isfinite(spread) and spread > 0:
        return 1 - math.floor(math.log10(spread))
    if math.isfinite(value) and value != 0:
        return 3 - math.floor(math.log10(abs(value)))
    return 2


def show(value: float | None, spread: float = math.nan) -> str:
    """A number with the digits that its uncertainty ``spread`` justifies; “–” if there is no value.

    Without a spread four digits are shown. Very large and very small numbers get a power of ten.
    """
    if value is None or not math.isfinite(value):
        return "–"
    decimals = digits(value, spread)
    largest = max(abs(value), spread if math.isfinite(spread) else 0.0)
    if largest != 0 and not 1e-3 <= largest < 1e6:
        power = math.floor(math.log10(largest))
        mantissa = value / 10.0**power
        text = f"{mantissa:.{min(max(decimals + power, 0), 9)}f}"
        return _minus(f"{text}×10{str(power).translate(SUPERSCRIPT)}")
    if decimals < 0:
        value, decimals = round(value, decimals), 0
    text = f"{value:.{min(decimals, 9)}f}"
    if float(text) == 0:
        text = text.lstrip("-")
    return _minus(text)


def _minus(text: str) -> str:
    return "−" + text[1:] if text.startswith("-") else text


def percent(fraction: float) -> str:
    return f"{100 * fraction:.0f} %"


def duration(seconds: float) -> str:
    """A duration in a convenient unit."""
    year = 365.25 * 86400
    for unit, size in (("years", year), ("days", 86400.0), ("hours", 3600.0), ("minutes", 60.0)):
        if seconds >= 2 * size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.3g} s"
