"""`lcbayes.compare` and what it returns: how many facets, for Python."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from lcbayes.core.checkpoint import Checkpoint
from lcbayes.core.errors import InputError
from lcbayes.core.files import write_atomic
from lcbayes.core.progress import Silent
from lcbayes.core.version import installed_version
from lcbayes.data.lightcurve import LightCurve
from lcbayes.results.folder import alone_in, made_aside, make_folder, record
from lcbayes.results.verdict import Judged
from lcbayes.tasks.fit.run import check_curve

WRITTEN = ("compare.json", "compare.csv", "compare.html", "run.toml")
PAGE = ("compare.html", "figures/compare.png")
MOST = 50  # facets; a guard against slips, far beyond what data tell


class Comparison(Judged):
    """Numbers of facets with their evidence, and what follows from it; `summary` is the content of
    ``compare.json``."""

    @property
    def conclusion(self) -> str:
        """One sentence."""
        return self._summary["conclusion"]

    @property
    def probability(self) -> dict[int, float]:
        """Of each number of facets."""
        rows = [*self._summary["candidates"], *self._summary["ruled_out"]]
        return {row["n_facets"]: float(row["probability"]) for row in rows}

    def table(self) -> str:
        """The numbers, the notes they need and the conclusion, as text."""
        from lcbayes.results.comparison import table

        return table(self._summary)

    def save(self, folder: str | Path) -> Path:
        """Write compare.json, compare.csv and run.toml; the page of an earlier result goes."""
        from lcbayes.results.comparison import COLUMNS

        folder = make_folder(folder)
        text = io.StringIO()
        text.writelines(f"# {name}: {meaning}\n" for name, meaning in COLUMNS.items())
        rows = csv.DictWriter(text, COLUMNS, extrasaction="ignore", lineterminator="\n")
        rows.writeheader()
        every = [*self._summary["candidates"], *self._summary["ruled_out"]]
        rows.writerows(sorted(every, key=lambda row: row["n_facets"]))
        with made_aside(folder, PAGE) as aside:
            self._write(aside, "compare.json")
            write_atomic(
                aside / "compare.csv", lambda p: p.write_text(text.getvalue(), encoding="utf-8")
            )
        return folder

    def report(self, folder: str | Path) -> Path:
        """Write everything `save` does, the figure and the page."""
        from lcbayes.analysis import comparison_page

        return comparison_page.write(self.save(folder), self._summary, self._run)

    def __repr__(self) -> str:
        trust = "" if self.converged else "; NOT to be trusted: " + "; ".join(self.reasons)
        return f"Comparison({self.conclusion}{trust})"


def compare(
    curve: LightCurve,
    n_facets: Iterable[int] = range(1, 9),
    model: str = "faceted",
    *,
    seed: int = 0,
    num_particles: int = 100,
    num_runs: int = 4,
    num_starts: int = 0,
    sparse: int | None = None,
    out: str | Path | None = None,
    report: bool = False,
    progress: Silent | None = None,
    reading: Mapping[str, Any] | None = None,
    **options: Any,
) -> Comparison:
    """How many facets a light curve asks for.

    For each number, independent runs of tempered particles go from the prior to the posterior and
    find its evidence; the runs' spread is its error. Beside it stand the predictive densities of
    epochs left out, which ask another question: not which number is true, but which predicts best.

    Parameters
    ----------
    curve : LightCurve
        From `lcbayes.read`.
    n_facets : ints
        Numbers to compare, two at least; each as likely as the others before the data.
    model : str
        "faceted", "faceted-brdf", "stabilised", or the path of a model file with an option
        ``n_facets``.
    seed : int
        The same input, version, seed and device give the same numbers.
    num_particles, num_runs : int
        Particles that move, and independent runs, for each number.
    num_starts : int
        Of the search for the best fit, whose residuals tell how much a point is worth; 0: 64.
    sparse : int, optional
        Upper bound of facets from which to take the sparse path of Linares & Crassidis, sec. VI.
        The number at which it ends is compared with the others.
    out : path, optional
        Folder for the results and for a checkpoint, with which a killed run resumes to the same
        numbers.
    report : bool
        Write the page there too; `Comparison.report` does it later.
    reading : mapping, optional
        Options with which the curve was read, to be kept in run.toml.
    progress : optional
        `lcbayes.core.progress.Console()` shows how far it is.
    **options
        Of the model.

    Returns
    -------
    Comparison

    Raises
    ------
    InputError
        If the curve, an option or a setting is at fault.

    Examples
    --------
    >>> found = lcbayes.compare(curve, range(1, 5), seed=1)         # doctest: +SKIP
    >>> print(found.conclusion)                                     # doctest: +SKIP
    """
    from lcbayes.inference import facet_count as engine
    from lcbayes.inference.fit import identity as identity_of
    from lcbayes.modelling import registry
    from lcbayes.results.comparison import summarise
    from lcbayes.samplers.settings import PARTICLES, Settings

    progress = progress or Silent()
    counts = _counts(n_facets)
    for name, value, least in (
        ("num_particles", num_particles, 10),
        ("num_runs", num_runs, 2),
        ("num_starts", num_starts, 0),
        ("seed", seed, 0),
    ):
        if not isinstance(value, int) or value < least:
            flag = name.replace("_", "-")
            raise InputError(f"--{flag} is {value!r}; give a whole number >= {least}")
    entry = registry.find(model)
    _check_model(entry, sparse, counts)
    checked = entry.check({**options, "n_facets": counts[0]})
    del checked["n_facets"]
    check_curve(curve)
    settings = Settings(PARTICLES, seed, None, num_particles, num_runs, num_starts)
    asked = {"facets": ",".join(map(str, counts)), "sparse": sparse or 0}
    identity = identity_of(curve, entry, checked, settings, installed_version()) | asked
    with alone_in(out, WRITTEN) as folder:
        checkpoint = Checkpoint(folder and folder / "checkpoint", identity, progress.say)
        found = engine.run(curve, entry, checked, counts, settings, sparse, checkpoint, progress)
        summary = summarise(found, identity, curve.n_obs, seed)
        numbers = {
            "command": "compare",
            **asked,
            "seed": seed,
            "num_particles": num_particles,
            "num_runs": num_runs,
            "num_starts": num_starts,
        }
        compared = Comparison(summary, record(curve, model, numbers, checked, reading))
        if folder is not None:
            compared.report(folder) if report else compared.save(folder)
            checkpoint.finish()
    return compared


def _counts(given: Iterable[int]) -> list[int]:
    counts = sorted(set(given))
    if len(counts) < 2:
        raise InputError(
            f"--facets is {','.join(map(str, counts)) or 'empty'}; give two numbers or more to "
            "compare, such as 1-8 or 2,3,5"
        )
    if counts[0] < 1 or counts[-1] > MOST:
        raise InputError(f"--facets is {','.join(map(str, counts))}; give numbers from 1 to {MOST}")
    return counts


def _check_model(entry: Any, sparse: int | None, counts: list[int]) -> None:
    """That the model can be asked what is asked."""
    if "n_facets" not in entry.options or entry.hook("starts") is not None:
        raise InputError(
            f"--model {entry.name} has no number of facets to compare; available: faceted, "
            "faceted-brdf, stabilised, or a file whose model has an option n_facets"
        )
    if sparse is None:
        return
    asked = {"sparsity", "log_area_sd"}
    if not asked <= set(entry.options) or "normals_base" not in entry.facet_sites:
        raise InputError(
            f"--sparse goes with faceted and faceted-brdf: {entry.name} lacks their options "
            "sparsity and log_area_sd, or their site normals_base"
        )
    if not counts[0] < sparse <= MOST:
        raise InputError(
            f"--sparse is {sparse}; give an upper bound of facets from {counts[0] + 1} to {MOST}"
        )
