"""Rotation angles of an asteroid at other dates."""

# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownArgumentType=false, reportUnknownVariableType=false

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lcbayes.core.errors import InputError
from lcbayes.core.files import write_text
from lcbayes.core.reasons import Reason
from lcbayes.results.asteroid import Asteroid
from lcbayes.results.content import Verdict
from lcbayes.results.result import Result

if TYPE_CHECKING:
    import pandas as pd

NO_ASTEROID = (
    "{folder} holds no fit of a body on a grid of normals that rotates about a fixed pole at "
    "absolute times; give a fit of the model convex-grid"
)


def rotations(asteroids: Sequence[Asteroid], dates: Sequence[float]) -> dict[str, Any]:
    """The rotation angle φ of each solution at Julian dates, mean, sd and 90 % interval in deg.

    Returns
    -------
    dict
        Columns with a row for each solution and date.
    """
    rows: list[tuple[Any, ...]] = []
    for number, asteroid in enumerate(asteroids, 1):
        angles = asteroid.rotation_angle_deg(dates)
        low, high = np.quantile(angles, (0.05, 0.95), axis=0)
        sd = angles.std(axis=0, ddof=1) if len(angles) > 1 else np.full(len(dates), np.nan)
        for k, jd in enumerate(dates):
            mean = angles[:, k].mean()
            rows.append((jd, number, asteroid.weight, mean % 360.0, sd[k], low[k], high[k]))
    names = ("jd", "solution", "weight", "rotation_deg", "rotation_sd_deg", "q05_deg", "q95_deg")
    return dict(zip(names, map(np.array, zip(*rows, strict=True)), strict=True))


class RotationContent(Verdict):
    """Content of the summary of `lcbayes.predict` with dates."""

    rotation: list[dict[str, float]]


class RotationPrediction(Result[RotationContent]):
    """Rotation angles at dates. It is trusted if the fit is trusted."""

    task = "predict"

    def __init__(self, columns: Mapping[str, Any], reasons: Sequence[Reason]) -> None:
        rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
        super().__init__({"rotation": rows}, reasons, {})
        self._columns = dict(columns)

    @property
    def data(self) -> dict[str, Any]:
        """The columns of the table as arrays."""
        return self._columns

    def summary(self) -> pd.DataFrame:
        """One row per solution and date: rotation angle φ of ``spin.txt``, sd, 90 % (deg)."""
        import pandas as pd

        return pd.DataFrame(self._columns).assign(trusted=self.trusted)

    def tables(self) -> dict[str, pd.DataFrame]:
        return {"rotation": self.summary()}

    def lines(self) -> list[str]:
        lines = ["rotation angle (as phi of spin.txt), deg; sd includes that of the shape"]
        for row in self.content["rotation"]:
            lines.append(
                f"  JD {row['jd']:.5f}  solution {row['solution']:.0f} (weight "
                f"{row['weight']:.2g}): {row['rotation_deg']:.1f} ± {row['rotation_sd_deg']:.1f}"
            )
        return lines

    def save(self, folder: str | Path) -> Path:
        """Write the table as a CSV file with this path."""
        table = self.summary().assign(trusted="true" if self.trusted else "false")
        write_text(table.to_csv(index=False, lineterminator="\n"), folder)
        return Path(folder)

    def write_page(self, folder: Path) -> None:
        from lcbayes.analysis import small_report

        small_report.write_page(folder, self, lambda _: None)


def check(asteroids: Sequence[Asteroid], folder: Path) -> None:
    """Raise an InputError if the fit is not of an asteroid."""
    if not asteroids:
        raise InputError(NO_ASTEROID.format(folder=folder))
