"""Result of `lcbayes.simulate`."""

# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownArgumentType=false, reportUnknownVariableType=false
# (pandas, xarray, ArviZ and JAX come without complete types)

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lcbayes.core.errors import InputError
from lcbayes.core.files import write_text
from lcbayes.data.lightcurve import LightCurve
from lcbayes.data.write import write
from lcbayes.results.content import Verdict
from lcbayes.results.result import Result
from lcbayes.simulation.simulate import sidecar

if TYPE_CHECKING:
    import pandas as pd

SUFFIXES = (".csv", ".ecsv")


class SimulateContent(Verdict):
    """Content of the summary of `lcbayes.simulate`."""

    n_obs: int
    truth: dict[str, Any]


class Simulation(Result[SimulateContent]):
    """A simulated light curve and the truth from which it was generated.

    Attributes
    ----------
    data : LightCurve
    truth : dict
        Values that a perfect fit recovers; see `lcbayes.simulation.simulate.truth`.
    """

    task = "simulate"

    def __init__(self, curve: LightCurve, truth: Mapping[str, Any]) -> None:
        super().__init__({"n_obs": curve.n_obs, "truth": truth}, [], {})
        self._curve, self.truth = curve, dict(truth)
        self._file: Path | None = None

    @property
    def data(self) -> LightCurve:
        return self._curve

    def summary(self) -> pd.DataFrame:
        """One row per point: time (s), brightness and its standard deviation."""
        import pandas as pd

        curve = self._curve
        unit = "mag" if curve.kind == "mag" else "flux"
        return pd.DataFrame(
            {"t_s": curve.t, unit: curve.brightness, f"{unit}_err": curve.error, "site": curve.site}
        )

    def lines(self) -> list[str]:
        dark = self.truth["n_dark_left_out"]
        left_out = f" ({dark} epochs at which the body is dark left out)" if dark else ""
        points = f"{self._curve.n_obs} points of {self.truth['scenario']}{left_out}"
        if self._file is None:
            return [points]
        return [f"{self._file}: {points}; truth: {sidecar(self._file)}"]

    def save(self, folder: str | Path) -> Path:
        """Write the light curve to a .csv or .ecsv file, and the truth to a file next to it.

        Raises
        ------
        InputError
            The file cannot be written.
        """
        path = Path(folder)
        write(self._curve, path)
        write_text(json.dumps(self.truth, indent=1) + "\n", sidecar(path))
        self._file = path
        return path

    def report(self, folder: str | Path) -> Path:
        raise InputError(f"a simulation has no report; write its light curve with save({folder!r})")

    def write_page(self, folder: Path) -> None:
        self.report(folder)
