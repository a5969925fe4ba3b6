"""What a fit says about another body that may explain the data."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from lcbayes.core.reasons import Finding
from lcbayes.inference.rival import SHARE, SPIN, Rival
from lcbayes.results.content import Rivals

LEAST_HELD = 0.6  # probability of a 90 % interval, averaged over both bodies, that is trusted
ALIKE = 3.0  # nats; a body with less evidence by more than that explains the data worse
WORDS = {
    "period_h": "the period",
    "pole_lon_deg": "the longitude of the pole",
    "pole_lat_deg": "the latitude of the pole",
}
NAMES = {"contact-binary": "contact binary of two ellipsoids", "convex-grid": "convex body"}


def content_of(rival: Rival | None) -> Rivals:
    """The rival in ``summary.json``, if there is one; ``log_odds`` is null if it fits so badly that
    the evidence was not computed."""
    if rival is None:
        return {}
    return {
        "rival": {
            "model": rival.model,
            "solution": rival.solution + 1,
            "log_odds": rival.log_odds if math.isfinite(rival.log_odds) else None,
            "rms": rival.rms,
            "spin": {k: {"mean": mean, "sd": sd} for k, (mean, sd) in rival.spin.items()},
            "interval_probability": dict(rival.held),
        }
    }


def findings(rival: Rival | None) -> Iterator[Finding]:
    """A rival whose spin the 90 % intervals of the fit do not hold."""
    if rival is None or not rival.held:
        return
    what, held = min(rival.held.items(), key=lambda item: item[1])
    if held < LEAST_HELD:
        yield Finding(
            "another-body",
            {
                "body": NAMES[rival.model],
                "log_odds": rival.log_odds,
                "motion": _spin(rival.spin),
                "what": WORDS[what],
                "percent": 100.0 * held,
                "nominal": 100.0 * SHARE,
                "model": rival.model,
            },
        )


def lines(content: Mapping[str, Any] | None) -> list[str]:
    """A line on the rival, from its content in ``summary.json``, unless it is a reason."""
    if not content:
        return []
    odds, rms = content["log_odds"], f"rms {content['rms']:.4g}"
    said = f"for comparison, a {NAMES[content['model']]} near the same spin"
    if odds is None:
        return [f"{said} fits much worse ({rms})"]
    said = f"{said} has ln evidence {odds:+.1f} relative to this fit ({rms})"
    if odds < -ALIKE:
        return [f"{said}, which is worse"]
    if min(content["interval_probability"].values()) < LEAST_HELD:
        return []
    spin = _spin({k: (v["mean"], v["sd"]) for k, v in content["spin"].items()})
    return [f"{said}, and its spin agrees: {spin}; for its shape, --model {content['model']}"]


def _spin(spin: Mapping[str, tuple[float, float]]) -> str:
    """Period and pole with their standard deviations."""
    (period, period_sd), (lon, lon_sd), (lat, lat_sd) = (spin[k] for k in SPIN)
    digits = max(0, 1 - math.floor(math.log10(period_sd))) if period_sd > 0.0 else 6
    return (
        f"period {period:.{digits}f} ± {period_sd:.{digits}f} h, pole ({lon % 360.0:.1f} ± "
        f"{lon_sd:.1f}, {lat:+.1f} ± {lat_sd:.1f}) deg"
    )
