"""Result of `lcbayes.predict` with an occultation."""

# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownArgumentType=false, reportUnknownVariableType=false

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lcbayes.analysis import occultation_plots, style
from lcbayes.analysis.numerals import show
from lcbayes.core.constants import AU_KM
from lcbayes.core.reasons import Reason
from lcbayes.data.formats.occultation import Occultation
from lcbayes.results.content import BodyRow, Verdict
from lcbayes.results.result import Result
from lcbayes.tasks.predict.outline import Outline

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


class OutlineContent(Verdict):
    """Content of the summary of `lcbayes.predict` with an occultation."""

    occultation: str
    events: list[dict[str, Any]]
    solutions: list[dict[str, Any]]
    diameter_km: BodyRow | None
    notes: list[str]


class OutlinePrediction(Result[OutlineContent]):
    """Outlines over chords: share of the ends inside the 90 % band, diameter and weights.

    It is not trusted if the fit is not, or if the chords choose too few bodies of the posterior.
    """

    task = "predict"

    def __init__(
        self,
        outlines: Sequence[Outline],
        events: Sequence[Occultation],
        content: Mapping[str, object],
        reasons: Sequence[Reason],
    ) -> None:
        super().__init__(content, reasons, {})
        self._outlines, self._events = list(outlines), list(events)

    @property
    def data(self) -> list[Outline]:
        """Each solution with its bodies over the chords."""
        return self._outlines

    def summary(self) -> pd.DataFrame:
        """One row per solution: pole (deg), weights, ends inside the band, diameters (km)."""
        import pandas as pd

        rows = []
        for number, one in enumerate(self.content["solutions"], 1):
            flat = {k: v for k, v in one.items() if not isinstance(v, dict)}
            for name in ("diameter_from_light_curves_km", "diameter_km"):
                for key in ("mean", "sd", "q05", "q95"):
                    flat[f"{name}_{key}"] = (one[name] or {}).get(key, np.nan)
            rows.append({"solution": number, **flat})
        return pd.DataFrame(rows).drop(columns="diameter_km", errors="ignore")

    def tables(self) -> dict[str, pd.DataFrame]:
        return {"solutions": self.summary(), "ends": self._ends(), "outlines": self._bands()}

    def _ends(self) -> pd.DataFrame:
        """One row per end of a chord and solution: distance from the outlines (km)."""
        import pandas as pd

        parts = []
        for number, one in enumerate(self._outlines, 1):
            chords, distance = one.chords, one.placed.distance
            low, middle, high = np.quantile(distance, (0.05, 0.5, 0.95), axis=0)
            parts.append(
                pd.DataFrame(
                    {
                        "solution": number,
                        "event": chords.event + 1,
                        "chord": chords.chord + 1,
                        "end": np.tile(["disappearance", "appearance"], len(low) // 2),
                        "west_km": chords.ends[:, 0],
                        "north_km": chords.ends[:, 1],
                        "timing_km": np.linalg.norm(chords.along_km, axis=1),
                        "distance_q05_km": low,
                        "distance_q50_km": middle,
                        "distance_q95_km": high,
                        "inside_90": one.inside(relief=True),
                        "inside_90_without_relief": one.inside(relief=False),
                    }
                )
            )
        return pd.concat(parts, ignore_index=True)

    def _bands(self) -> pd.DataFrame:
        """One row per direction, event and solution: quantiles of the outlines (km)."""
        import pandas as pd

        parts = []
        for number, one in enumerate(self._outlines, 1):
            for event in range(len(self._events)):
                angle, radii, limb = one.band(event)
                west, north = one.middle(event)
                columns = {"solution": number, "event": event + 1, "west_km": west}
                columns |= {"north_km": north, "angle_deg": np.degrees(angle)}
                columns |= dict(zip(("q05_km", "q50_km", "q95_km"), radii, strict=True))
                columns |= {"limb_q05_km": limb[0], "limb_q95_km": limb[-1]}
                parts.append(pd.DataFrame(columns))
        return pd.concat(parts, ignore_index=True)

    def lines(self) -> list[str]:
        content = self.content
        lines = [
            f"event {i}: {e['n_chords']} chords, {e['n_negative']} negative, "
            f"JD {e['jd']:.5f}, distance {e['distance_km'] / AU_KM:.4f} au"
            for i, e in enumerate(content["events"], 1)
        ]
        for i, one in enumerate(content["solutions"], 1):
            lines += _lines(i, one)
        total = content["diameter_km"]
        if total is not None:
            lines.append(f"volume-equivalent diameter, all solutions: {_diameter(total)}")
        return [*lines, *(f"note: {note}" for note in content["notes"])]

    def save(self, folder: str | Path) -> Path:
        """Write ``report.html``, ``figures/``, ``tables/`` and ``summary.json`` into a folder."""
        self.report(folder)
        return Path(folder)

    def write_page(self, folder: Path) -> None:
        from lcbayes.analysis import small_report

        small_report.write_page(folder, self, self._draw)

    def plot_outlines(self) -> list[Figure]:
        """The outlines over the chords, at one and two columns' width."""
        return style.figures(self._draw)

    def _draw(self, gallery: style.Gallery) -> None:
        panels = [
            [self._panel(i, event) for i in range(len(self._outlines))]
            for event in range(len(self._events))
        ]
        occultation_plots.draw_outlines(panels, gallery)

    def _panel(self, index: int, event: int) -> occultation_plots.Panel:
        one, content = self._outlines[index], self.content["solutions"][index]
        occultation = self._events[event]
        angle, radii, limb = one.band(event)
        here = one.chords.event == event
        after = "" if content["weight"] is None else f" → {content['weight']:.2f}"
        return occultation_plots.Panel(
            title=f"pole ({content['pole_lon_deg']:.0f}°, {content['pole_lat_deg']:+.0f}°), "
            f"weight {content['weight_before']:.2f}{after}",
            chords=occultation.place_km[~occultation.negative],
            negative=occultation.place_km[occultation.negative],
            inside=one.inside(relief=True)[here].reshape(-1, 2),
            middle=one.middle(event),
            angle=angle,
            radii=radii,
            limb=limb[[0, -1]],
        )


def _lines(number: int, one: Mapping[str, Any]) -> Iterator[str]:
    after = "" if one["weight"] is None else f", {one['weight']:.3g} after the chords"
    yield (
        f"solution {number}: pole ({one['pole_lon_deg']:.1f}°, {one['pole_lat_deg']:+.1f}°), "
        f"weight {one['weight_before']:.3g} from light curves{after}"
    )
    yield (
        f"  limb predicted from light curves, size and place fitted: {one['ends_inside_90']} of "
        f"{one['ends']} ends inside its 90 % band ({one['ends_inside_90_without_relief']} without "
        "relief)"
    )
    yield (
        f"  rms distance from the convex outlines {one['rms_distance_km']:.2g} km; relief by the "
        f"chords {100 * one['limb_relief']:.1f} % of the radius"
    )
    yield f"  diameter, shapes from light curves: {_diameter(one['diameter_from_light_curves_km'])}"
    if one["diameter_km"] is not None:
        yield f"  diameter, shapes weighted by the chords: {_diameter(one['diameter_km'])}"
    yield (
        f"  ln p(chords): {one['log_evidence_chords']:.1f}; effective number of bodies: "
        f"{one['effective_bodies']:.1f} of {one['n_bodies']}"
    )


def _diameter(row: BodyRow) -> str:
    mean, sd, low, high = (show(row[k], row["sd"]) for k in ("mean", "sd", "q05", "q95"))
    return f"{mean} ± {sd} km ({low} to {high})"
