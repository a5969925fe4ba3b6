"""`lcbayes.scan` and what it returns: hypotheses of attitude, ranked, for Python."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lcbayes.core.checkpoint import Checkpoint
from lcbayes.core.errors import InputError
from lcbayes.core.files import write_atomic
from lcbayes.core.progress import Silent
from lcbayes.core.version import installed_version
from lcbayes.data.lightcurve import LightCurve
from lcbayes.results.folder import REPORT, alone_in, made_aside, make_folder, record
from lcbayes.results.verdict import Judged
from lcbayes.tasks.fit.run import check_curve

if TYPE_CHECKING:
    from lcbayes.inversion.attitude_scan.result import Found

WRITTEN = ("summary.json", "hypotheses.csv", "run.toml", "report.html", "shape.obj")
ASTEROID, SATELLITE = "lommel-seeliger-lambert", "non-lambertian"
MOST_FACETS, MOST_DEGREE, MOST_KEPT = 5000, 12, 100


class Scan(Judged):
    """Solutions of an attitude scan, the best first; `summary` is the content of ``summary.json``.

    Attributes
    ----------
    found : Found
        Every hypothesis and every solution, as arrays.
    """

    def __init__(self, found: Found, summary: dict[str, Any], run: Mapping[str, Any]) -> None:
        super().__init__(summary, run)
        self.found = found

    @property
    def solutions(self) -> list[dict[str, Any]]:
        """The best first: pole and period or law, chi2, rms, and how it is related to the best."""
        return self._summary["solutions"]

    def save(self, folder: str | Path) -> Path:
        """Write summary.json, hypotheses.csv and run.toml; the page of an earlier result goes."""
        folder = make_folder(folder)
        heads, rows = self.found.table()
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerows([heads, *rows])
        with made_aside(folder, REPORT) as aside:
            self._write(aside, "summary.json")
            write_atomic(
                aside / "hypotheses.csv", lambda p: p.write_text(text.getvalue(), encoding="utf-8")
            )
        return folder

    def report(self, folder: str | Path) -> Path:
        """Write everything `save` does, the figures, the shape and the page."""
        from lcbayes.analysis import scan_page

        return scan_page.write(self.save(folder), self.found, self._summary, self._run)

    def __repr__(self) -> str:
        trust = "" if self.converged else "; NOT to be trusted: " + "; ".join(self.reasons)
        near = sum(s["near_equal"] for s in self.solutions)
        return f"Scan({self._summary['n_hypotheses']} hypotheses, {near} solution(s){trust})"


def scan(
    curve: LightCurve,
    *,
    period_h: float | None = None,
    period_range_h: tuple[float, float] | None = None,
    laws: Sequence[str] | None = None,
    reflectance: str | None = None,
    n_poles: int = 12,
    period_step: float = 0.8,
    n_facets: int = 500,
    degree: int = 6,
    keep: int = 12,
    n_sky: int = 200,
    common_noise: bool = False,
    scheduler: str | None = None,
    workers: int | None = None,
    out: str | Path | None = None,
    report: bool = False,
    progress: Silent | None = None,
    reading: Mapping[str, Any] | None = None,
) -> Scan:
    """Hypotheses of attitude, each with its best body, ranked and the best refined.

    Constant spins: every pole of a grid with every period of a range, each followed by
    Levenberg-Marquardt over pole, period and a smooth convex body. Laws: stabilised attitudes of
    the catalogue, each with the facets on a grid that fit best. Nothing is drawn at random.

    Parameters
    ----------
    curve : LightCurve
        From `lcbayes.read`.
    period_h : h, optional
        Sidereal period; or those to try:
    period_range_h : (h, h), optional
        Shortest and longest.
    laws : names, optional
        Of `physics.catalogue`; "all" stands for every one that the light curve has what it takes.
    reflectance : str, optional
        One of `brightness.DIFFUSE_LAWS`. Default: "lommel-seeliger-lambert" in ecliptic axes, which
        asteroids come in, else "non-lambertian".
    n_poles : int
        Poles to start from, all over the sky.
    period_step : float
        Of half a turn over the data between trial periods.
    n_facets, degree : int
        Of the body that solutions are refined with.
    keep : int
        Solutions to refine.
    n_sky : int
        Poles of the map of the sky about the best period; 0 leaves it out.
    common_noise : bool
        Where errors are unknown: one relative level for all curves, not one for each.
    scheduler, workers : optional
        Address of a Dask scheduler, or processes of a local one; else threads of this process.
    out : path, optional
        Folder for the results and for a checkpoint, with which a killed run resumes to the same
        numbers.
    report : bool
        Write the page there too; `Scan.report` does it later.
    progress : optional
        `lcbayes.core.progress.Console()` shows how far it is.
    reading : mapping, optional
        Options with which the curve was read, to be kept in run.toml.

    Returns
    -------
    Scan

    Raises
    ------
    InputError
        If the curve or an option is at fault.

    Examples
    --------
    >>> found = lcbayes.scan(curve, period_range_h=(5.75, 5.775))   # doctest: +SKIP
    >>> found.solutions[0]["pole_lon_deg"]                          # doctest: +SKIP

    References
    ----------
    Hall et al. 2007, sec. 3.4; Kaasalainen, Torppa & Muinonen 2001.
    """
    from lcbayes.inference.fit import digest
    from lcbayes.inversion.attitude_scan import engine
    from lcbayes.inversion.attitude_scan.verdict import summarise

    progress = progress or Silent()
    for name, value, least, most in (
        ("n-poles", n_poles, 1, 10_000),
        ("n-facets", n_facets, 50, MOST_FACETS),
        ("degree", degree, 1, MOST_DEGREE),
        ("keep", keep, 1, MOST_KEPT),
        ("n-sky", n_sky, 0, 100_000),
    ):
        if not least <= value <= most:
            raise InputError(f"--{name} is {value}; give a whole number from {least} to {most}")
    check_curve(curve)
    reflectance = reflectance or (ASTEROID if curve.frame == "ecliptic-j2000" else SATELLITE)
    settings = engine.Settings(
        period_h,
        period_range_h,
        tuple(laws or ()),
        reflectance,
        n_poles,
        period_step,
        n_facets,
        degree,
        keep,
        n_sky,
        common_noise,
    )
    identity = {
        "input": digest(curve),
        "command": "scan",
        "settings": repr(settings),
        "version": installed_version(),
    }
    with alone_in(out, WRITTEN) as folder:
        if folder is not None and (folder / "posterior.nc").exists():
            raise InputError(f"{folder} holds a fit; give another folder with -o")
        checkpoint = Checkpoint(folder and folder / "checkpoint", identity, progress.say)
        found = engine.run(curve, settings, scheduler, workers, checkpoint, progress)
        summary = summarise(found, curve)
        asked = {k: v for k, v in settings.as_dict().items() if v is not None}
        result = Scan(found, summary, record(curve, "scan", {"command": "scan"}, asked, reading))
        if folder is not None:
            result.report(folder) if report else result.save(folder)
            checkpoint.finish()
    return result
