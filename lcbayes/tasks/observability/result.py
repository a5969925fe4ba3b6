"""Result of `lcbayes.observability`."""

# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownArgumentType=false, reportUnknownVariableType=false
# (pandas, xarray, ArviZ and JAX come without complete types)

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from lcbayes.analysis import observability_page, observability_plots
from lcbayes.core.files import write_json
from lcbayes.results.result import Result
from lcbayes.simulation.observability import summary
from lcbayes.simulation.observability.summary import Findings
from lcbayes.tasks.deterministic import figure_of

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

NUMBERS = "observability.json"
MEASUREMENTS = {
    "t": "t_s",
    "site": "site",
    "mag": "mag",
    "mag_err": "mag_err",
    "information": "information_per_rad2",
    "rank": "rank",
}


class Observability(Result[dict[str, Any]]):
    """Information, bounds and undetermined combinations of a scenario, and a plan if requested.

    Attributes
    ----------
    data : lcbayes.simulation.observability.summary.Findings
    """

    task = "observability"

    def __init__(self, findings: Findings) -> None:
        self._numbers = summary.numbers(findings)
        short = {k: v for k, v in self._numbers.items() if k != "measurements"}
        super().__init__(short, [], {})
        self._found = findings

    @property
    def data(self) -> Findings:
        """Measurements, Fisher information, bounds and plan, as arrays."""
        return self._found

    def summary(self) -> pd.DataFrame:
        """One row per unknown: its unit, the width of its prior, and its bounds in that unit."""
        import pandas as pd

        c = self._numbers["campaign"]
        return pd.DataFrame(
            {
                "parameter": c["parameters"],
                "unit": c["units"],
                "prior_sd": c["prior_sd"],
                "crlb_sd": c["crlb_sd"],
                "crlb_sd_with_prior": c["crlb_sd_with_prior"],
                "nonlinearity": c["nonlinearity"],
            }
        )

    def lines(self) -> list[str]:
        return summary.words(self._found)

    def tables(self) -> dict[str, pd.DataFrame]:
        """The unknowns, the measurements and, with a plan, the schedule."""
        import pandas as pd

        m = self._numbers["measurements"]
        measured = pd.DataFrame(m, columns=list(MEASUREMENTS)).rename(columns=MEASUREMENTS)
        for name in ("mag_gradient", "flux_gradient"):
            unit = "mag_per_rad" if name == "mag_gradient" else "per_rad"
            rows = np.array([row[name] for row in m])
            for axis, values in zip("xyz", rows.T, strict=True):
                measured[f"{name}_{axis}_{unit}"] = values
        tables = {"unknowns": self.summary(), "measurements": measured}
        if self._numbers["plan"] is not None:
            tables["schedule"] = self._schedule()
        return tables

    def _schedule(self) -> pd.DataFrame:
        import pandas as pd

        plan = self._numbers["plan"]
        unit = "" if plan["unit"] == "1" else f"_{plan['unit'].replace('/', '_per_')}"
        rows = pd.DataFrame(plan["schedule"], columns=list(summary.COLUMNS))
        return rows.rename(columns={"sd_after": f"sd_after{unit}"})

    def write_files(self, folder: Path) -> None:
        """Write ``observability.json``: every measurement with its gradients, and the campaign."""
        write_json(self._numbers, folder / NUMBERS)

    def write_page(self, folder: Path) -> None:
        observability_page.write_page(self._found, self._numbers, folder, self._command())

    def _command(self) -> str:
        options = self.record.get("options", {})
        words = ["lcbayes", "observability", str(self.record.get("scenario", "SCENARIO"))]
        for name, value in options.items():
            several = isinstance(value, tuple | list)
            text = ",".join(map(str, cast("list[Any]", value))) if several else str(value)
            words += [f"--{name}", text]
        return shlex.join([*words, "-o", "DIR"])

    def plot_information(self) -> Figure:
        """Magnitude of every measurement, and the attitude error from it alone."""
        return figure_of(observability_plots.draw_information, self._found)

    def plot_hemisphere(self) -> Figure:
        """Information of a measurement from each direction in the body frame."""
        return figure_of(observability_plots.draw_hemisphere, self._found)

    def plot_seen(self) -> Figure:
        """The axis about which each measurement is sensitive to a rotation of the body."""
        return figure_of(observability_plots.draw_seen, self._found)

    def plot_bounds(self) -> Figure:
        """Bound of each unknown over the width of its prior."""
        return figure_of(observability_plots.draw_bounds, self._found)

    def plot_open(self) -> Figure:
        """The combinations of unknowns that the measurements leave undetermined."""
        return figure_of(observability_plots.draw_open, self._found)

    def plot_plan(self) -> Figure:
        """The visits of the plan, and the error of the target against their number."""
        return figure_of(observability_plots.draw_plan, self._found)
