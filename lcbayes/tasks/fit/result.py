"""Result of `lcbayes.fit`."""

# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownArgumentType=false, reportUnknownVariableType=false
# (pandas, xarray, ArviZ and JAX come without complete types)

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lcbayes.analysis import (
    asteroid_plots,
    contents,
    diagnostics_plots,
    light_curve_plots,
    quantities,
    shape_plots,
    sky_plots,
    style,
)
from lcbayes.analysis import report as page
from lcbayes.analysis.numerals import show
from lcbayes.core.reasons import Reason
from lcbayes.data.lightcurve import LightCurve
from lcbayes.modelling.variables import is_area, label
from lcbayes.results import rivals
from lcbayes.results.asteroid import QUANTITIES, tilt_warning
from lcbayes.results.content import BodyContent, FitContent, ParameterContent
from lcbayes.results.light_curve import load_light_curve
from lcbayes.results.load import open_posterior
from lcbayes.results.posterior import save_tree
from lcbayes.results.reasons import agreement, other_spins, residual_pattern, searched
from lcbayes.results.record import Record
from lcbayes.results.result import Result
from lcbayes.results.small_faults import measured_faults, rests_on

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from matplotlib.figure import Figure

LISTED = 24  # quantities of a solution in the text, and values of one quantity
# by their beginnings: the grids and matrices, and what the lines on the rotation say
UNLISTED = ("coefficients", "scale", "log_", "attitude", "rate_deg_s")
LEAST_WEIGHT_SD = 0.0005  # of a weight that is printed with its error
SHOWN = ("extent_ab", "extent_bc", "ellipsoid_ab", "ellipsoid_bc", "inertia_tilt_deg")
COLUMNS = ("mean", "sd", "q05", "q50", "q95", "rhat", "ess_bulk", "ess_tail")


class Fit(Result[FitContent]):
    """A posterior with its summary.

    Attributes
    ----------
    tree : xarray.DataTree
        Groups with ArviZ's names, and ``modes/0``, ``modes/1``, … with each solution's chains.
    """

    task = "fit"

    def __init__(
        self,
        tree: xr.DataTree,
        content: Mapping[str, object],
        reasons: Sequence[Reason],
        record: Mapping[str, Any] | None = None,
    ) -> None:
        super().__init__(content, reasons, record or {})
        self.tree = tree

    @classmethod
    def from_folder(
        cls, folder: Path, content: Mapping[str, object], reasons: Sequence[Reason], record: Record
    ) -> Fit:
        """The fit in a results folder."""
        with open_posterior(folder) as tree:
            return cls(tree.load(), content, reasons, record.content)

    @property
    def data(self) -> xr.DataTree:
        """The DataTree of ``posterior.nc``."""
        return self.tree

    @property
    def posterior(self) -> xr.Dataset:
        """The chains of all solutions as sampled; if there are several, use
        `lcbayes.weighted_draws` for draws of the posterior."""
        return self.tree["posterior"].to_dataset()

    @property
    def light_curve(self) -> LightCurve:
        """The fitted light curve."""
        return load_light_curve(self.tree)

    def summary(self) -> pd.DataFrame:
        """One row per parameter of each solution: weight, unit, mean, sd, quantiles, R-hat, ESS."""
        import pandas as pd

        rows = [
            {
                "solution": i,
                "weight": mode["weight"],
                "parameter": name,
                "unit": self._unit(name),
                **{key: row[key] for key in COLUMNS},
            }
            for i, mode in enumerate(self.content["modes"], 1)
            for name, row in mode["parameters"].items()
        ]
        return pd.DataFrame(rows, columns=["solution", "weight", "parameter", "unit", *COLUMNS])

    def tables(self) -> dict[str, pd.DataFrame]:
        import pandas as pd

        tables = {"parameters": self.summary()}
        if moved := self.content.get("rests_on"):
            tables["rests_on"] = pd.DataFrame(moved).rename_axis("parameter").reset_index()
        quality = self.content["fit"]
        if tests := quality.get("tests"):
            tables["residual_tests"] = pd.DataFrame(tests)
            tables["alternatives"] = pd.DataFrame(quality.get("alternatives", []))
        if spins := self.content.get("spins"):
            tables["spins"] = pd.DataFrame(
                {label("omega", (i,)): x for i, x in enumerate(s["omega_rad_s"])}
                | {k: s[k] for k in ("period_s", "share", "sampled")}
                for s in spins
            )
        if len(dimensions := self._dimensions()):
            tables["dimensions"] = dimensions
        if (curves := self._model_curves()) is not None:
            tables["model_curves"] = curves
        return tables

    def lines(self) -> list[str]:
        """Each solution: weight, residuals, mean, standard deviation and 90 % intervals."""
        content = self.content
        weights = [m["weight"] for m in content["modes"]]
        first = []
        if self.trusted:
            first = [agreement(weights, content["fit"])]
        elif content["fit"]["chi2"] is None:
            first = [residual_pattern(content["fit"])]
        unit = content["fit"]["rms_unit"]
        lines = [*first, "(mean ± standard deviation, and the interval that holds 90 %)"]
        for i, mode in enumerate(content["modes"], 1):
            weight = f"{mode['weight']:.3g}"
            if mode["weight_sd"] >= LEAST_WEIGHT_SD:
                weight += f" ± {mode['weight_sd']:.1g}"
            lines.append(f"solution {i}: weight {weight}, rms {mode['rms']:.4g} {unit}")
            lines += self._rotation(i - 1)
            lines += self._parameters(mode["parameters"])
            lines += _body(mode.get("body"))
        lines += [*other_spins(content.get("spins", [])), *searched(content.get("search"))]
        lines += measured_faults(content["modes"][0]["parameters"], self.reasons)
        lines += rivals.lines(content.get("rival"))
        return [*lines, *rests_on(content.get("rests_on", {}))]

    def _rotation(self, index: int) -> Iterator[str]:
        """Rotation rate, period and axis of a solution, in the units in which they are quoted."""
        node = f"modes/{index}" if "modes" in self.tree else ""
        draws = self.tree[f"{node}/posterior"].to_dataset()
        listed = quantities.rotation(draws, str(self.tree.attrs.get("frame", "inertial")))
        width = max([22, *(len(q.words) for q in listed)])
        for q in listed:
            mean, low, high = (show(x, q.sd) for x in (q.mean, q.quantile(0.05), q.quantile(0.95)))
            shown = f"{mean:>10s} ± {show(q.sd, q.sd)} {q.unit}"
            yield f"  {q.words:{width}s} {shown:32s} {low} to {high}"

    def _parameters(self, parameters: Mapping[str, ParameterContent]) -> Iterator[str]:
        rows = {name: row for name, row in parameters.items() if not name.startswith(UNLISTED)}
        entries = Counter(name.partition("[")[0] for name in rows)
        # areas on a grid and offsets of many satellites are too many to list
        short = [name for name in rows if entries[name.partition("[")[0]] <= LISTED][:LISTED]
        width = max([22, *map(len, short)])
        for name in short:
            row = rows[name]
            mean, sd, low, high = (
                show(value, row["sd"]) for value in (row["mean"], row["sd"], row["q05"], row["q95"])
            )
            shown = f"{mean:>10s} ± {sd} {self._unit(name)}"
            yield f"  {name:{width}s} {shown:32s} {low} to {high}"
        if len(rows) > len(short):
            yield f"  … and {len(rows) - len(short)} more in summary.json"

    def _dimensions(self) -> pd.DataFrame:
        """One row per quantity of the body of each solution, with its definition."""
        import pandas as pd

        return pd.DataFrame(
            {"solution": i, "weight": mode["weight"], "quantity": name, **row}
            | {"definition": QUANTITIES[name]}
            for i, mode in enumerate(self.content["modes"], 1)
            if (body := mode.get("body")) is not None
            for name, row in body["quantities"].items()
        )

    def _model_curves(self) -> pd.DataFrame | None:
        """The model light curves of an asteroid's solutions; None for other objects."""
        import pandas as pd

        if not any("body" in mode for mode in self.content["modes"]):
            return None
        results = self._contents()
        curves = [asteroid_plots.model_curves(results, mode) for mode in results.modes]
        parts = [pd.DataFrame(columns) for columns in curves if columns is not None]
        return pd.concat(parts, ignore_index=True) if parts else None

    def _unit(self, name: str) -> str:
        base = name.partition("[")[0]
        free = self.tree["constant_data"].to_dataset().get("free_scale")
        if is_area(base):
            return "" if free is not None and bool(free.all()) else "m²"
        return quantities.KNOWN.get(base, ("", "", 0.0))[1]

    def write_files(self, folder: Path) -> None:
        save_tree(self.tree, folder / "posterior.nc")

    def write_page(self, folder: Path) -> None:
        saved = (folder / "posterior.nc").is_file()
        page.write_page(folder, contents.read(folder if saved else self.folder or folder))

    def plot_light_curve(self) -> list[Figure]:
        """Brightness with its posterior prediction, one figure per solution or pass."""
        return style.figures(lambda g: light_curve_plots.draw_panels(self._contents(), g))

    def plot_residuals(self) -> list[Figure]:
        """Residuals against time."""
        return style.figures(lambda g: light_curve_plots.draw_residuals(self._contents(), g))

    def plot_folded(self) -> list[Figure]:
        """All points against rotational phase; none if the period does not fix the phases."""
        return style.figures(lambda g: light_curve_plots.draw_folded(self._contents(), g))

    def plot_residual_periodogram(self) -> list[Figure]:
        """Part of the χ² of the residuals explained by a sinusoid, against its period."""
        return style.figures(
            lambda g: light_curve_plots.draw_residual_periodogram(self._contents(), g)
        )

    def plot_model_curves(self) -> list[Figure]:
        """Curves of an asteroid against its rotation, two figures per solution: 88 and 180 mm
        wide, as journals print them; none for other objects."""
        results = self._contents()

        def draw(gallery: style.Gallery) -> None:
            for mode in results.modes:
                asteroid_plots.draw_phased(results, mode, gallery)

        return style.figures(draw)

    def plot_parameters(self) -> list[Figure]:
        """Pairs of the most important quantities, one figure per solution."""

        def draw(gallery: style.Gallery) -> None:
            for mode, selected in self._important():
                diagnostics_plots.draw_pairs(mode, selected, gallery)

        return style.figures(draw)

    def plot_trace(self) -> list[Figure]:
        """Chains of the most important quantities, one figure per solution."""

        def draw(gallery: style.Gallery) -> None:
            for mode, selected in self._important():
                diagnostics_plots.draw_traces(mode, selected, gallery)

        return style.figures(draw)

    def plot_sky(self) -> list[Figure]:
        """Directions of the spin axis and of the facets' normals."""
        results = self._contents()

        def draw(gallery: style.Gallery) -> None:
            sky_plots.draw_sky(results, gallery)
            for mode in results.modes:
                sky_plots.draw_facets(results, mode, gallery)

        return style.figures(draw)

    def plot_body(self) -> list[Figure]:
        """The body of each solution whose facets close."""
        results = self._contents()

        def draw(gallery: style.Gallery) -> None:
            for mode in results.modes:
                shape_plots.build(results, mode, gallery)

        return style.figures(draw)

    def _important(self) -> Iterator[tuple[contents.Mode, Any]]:
        results = self._contents()
        for mode in results.modes:
            yield mode, quantities.important(list(quantities.quantities(results, mode)))

    def _contents(self) -> contents.Results:
        return contents.assemble(self.folder or Path(), self.tree, dict(self.content), "")


def _body(body: BodyContent | None) -> Iterator[str]:
    """The axis ratios of the body of a solution, and a warning if it should not spin so."""
    if body is None or not body["quantities"]:
        return
    for name in SHOWN:
        row = body["quantities"][name]
        mean, sd, low, high = (show(row[k], row["sd"]) for k in ("mean", "sd", "q05", "q95"))
        yield f"  {name:22s} {f'{mean:>10s} ± {sd}':32s} {low} to {high}"
    if body["n_failed"]:
        total = body["n_bodies"] + body["n_failed"]
        yield f"  note: no convex body was found for {body['n_failed']} of {total} draws"
    if warning := tilt_warning(body):
        yield f"  warning: {warning}"
