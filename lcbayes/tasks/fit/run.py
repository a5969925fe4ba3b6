"""`lcbayes.fit` and what it returns: the front door for Python."""

from __future__ import annotations

import json
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lcbayes.core.checkpoint import Checkpoint
from lcbayes.core.errors import InputError
from lcbayes.core.files import printable
from lcbayes.core.progress import Silent
from lcbayes.core.version import installed_version
from lcbayes.data.lightcurve import LightCurve
from lcbayes.results.folder import REPORT, alone_in, made_aside, make_folder, record
from lcbayes.results.verdict import Judged

if TYPE_CHECKING:
    import xarray as xr

    from lcbayes.modelling.registry import Entry


FRAMES = {
    "icrs": "the axes of ICRS",
    "ecliptic-j2000": "the axes of the ecliptic of J2000",
    "inertial": "the inertial axes of the file",
}
NOISE = {
    "student-t": "Noise follows Student's t of 4 degrees of freedom: outliers weigh less.",
    "mixture": "Some points are outliers, which scatter more widely; how many is inferred.",
}
UNSURE_DEG = 1.0  # of the direction of flight, 1 sd, from which on it is said
WRITTEN = ("posterior.nc", "summary.json", "run.toml")


class Fit(Judged):
    """A posterior with its summary, the content of ``summary.json``.

    Attributes
    ----------
    tree : xarray.DataTree
        Groups as ArviZ names them, and ``modes/0``, ``modes/1``, … with each solution's chains.
    """

    def __init__(self, tree: xr.DataTree, summary: dict[str, Any], run: Mapping[str, Any]) -> None:
        super().__init__(summary, run)
        self.tree = tree

    @property
    def posterior(self) -> xr.Dataset:
        """Equally weighted draws; the variable ``mode`` says to which solution each belongs."""
        return self.tree["posterior"].to_dataset()

    def save(self, folder: str | Path) -> Path:
        """Write posterior.nc, summary.json and run.toml; the report of an earlier result goes."""
        from lcbayes.results.posterior import save_tree

        folder = make_folder(folder)
        with made_aside(folder, REPORT) as aside:
            save_tree(self.tree, aside / "posterior.nc")
            self._write(aside, "summary.json")
        return folder

    def report(self, folder: str | Path) -> Path:
        """Write everything `save` does, the report, its figures and the shape."""
        from lcbayes.analysis import report

        return report.write(self.save(folder))

    def __repr__(self) -> str:
        s = self._summary
        trust = "converged" if s["converged"] else "NOT to be trusted: " + "; ".join(s["reasons"])
        return f"Fit({s['model']}, {s['n_obs']} points, {len(s['modes'])} solution(s), {trust})"


def fit(
    curve: LightCurve,
    model: str = "faceted",
    *,
    sampler: str = "nuts",
    seed: int = 0,
    num_warmup: int | None = None,
    num_samples: int = 0,
    num_chains: int = 4,
    num_starts: int = 0,
    max_modes: int = 4,
    start_from: str | Path | None = None,
    out: str | Path | None = None,
    report: bool = False,
    progress: Silent | None = None,
    reading: Mapping[str, Any] | None = None,
    **options: Any,
) -> Fit:
    """Posterior over shape, spin and surface from a light curve.

    A search from many starts finds the solutions; each is sampled by its own chains; their weights
    are their shares of the evidence.

    Parameters
    ----------
    curve : LightCurve
        From `lcbayes.read`.
    model : str
        "faceted", "faceted-brdf", "convex-grid", "stabilised", or the path of a model file.
    sampler : str
        "nuts", "ahmc" (Fisher-adaptive HMC, exact), "smc" (particles from the prior, for posteriors
        of many solutions), "hmc", "rmhmc", "mh" (random walk), or "ahmc-paper", the published rule,
        whose result is never to be trusted.
    seed : int
        The same input, version, seed and device give the same numbers.
    num_warmup, num_samples, num_chains : int
        Per solution. None and 0 take what serves the sampler: a warm-up of 200 for NUTS, and 750
        draws, up to 3000 where these are worth too few independent ones and more will do. For "smc"
        the number of particles that move (250), and of independent runs.
    num_starts : int
        Starts of the search where the model has no own; 0 chooses by the number of parameters.
    max_modes : int
        Solutions to sample at most.
    start_from : path, optional
        Results of `lcbayes.scan` of the same light curve, whose best spins the search starts from.
        The model "convex-grid" takes its period from there if none is given.
    out : path, optional
        Folder for the results and for a checkpoint, with which a killed run resumes to the same
        numbers.
    report : bool
        Write the report there too; `Fit.report` does it later.
    reading : mapping, optional
        Options with which the curve was read, to be kept in run.toml.
    progress : optional
        `lcbayes.core.progress.Console()` shows how far it is.
    **options
        Of the model, such as ``n_facets``; `lcbayes models NAME` lists them.

    Returns
    -------
    Fit

    Raises
    ------
    InputError
        If the curve, an option or a setting is at fault.

    Examples
    --------
    >>> curve = lcbayes.read("pass.csv")                            # doctest: +SKIP
    >>> found = lcbayes.fit(curve, n_facets=3, seed=1, out="out")   # doctest: +SKIP
    >>> found.report("out")                                         # doctest: +SKIP
    """
    from lcbayes.inference import fit as engine
    from lcbayes.modelling import registry
    from lcbayes.results import posterior as results
    from lcbayes.results.scan_start import read_scan
    from lcbayes.results.summary import summarise
    from lcbayes.samplers.settings import Settings

    progress = progress or Silent()
    settings = Settings(sampler, seed, num_warmup, num_samples, num_chains, num_starts, max_modes)
    entry = registry.find(model)
    check_curve(curve)
    spins = [] if start_from is None else read_scan(start_from, curve)
    if spins and "period" in entry.options:
        options = {"period": spins[0]["period_h"]} | options
    checked = entry.check(options)
    identity = engine.identity(curve, entry, checked, settings, installed_version())
    if spins:
        identity |= {"start_from": repr(spins)}
    with alone_in(out, WRITTEN) as folder:
        checkpoint = Checkpoint(folder and folder / "checkpoint", identity, progress.say)
        posterior = engine.run(curve, entry, checked, settings, checkpoint, progress, spins)
        progress.say("judging the draws: predicted brightness, leave-one-out")
        tree = results.tree(posterior, curve, entry, checked, seed)
        summary = summarise(posterior, tree, curve, identity, seed)
        tree.attrs = _attributes(curve, summary, entry, seed, checked)
        begun = {} if start_from is None else {"start_from": str(Path(start_from).resolve())}
        run = record(curve, model, settings.as_dict() | begun, checked, reading)
        found = Fit(tree, summary, run)
        if folder is not None:
            if report:
                progress.say("drawing the report")
            found.report(folder) if report else found.save(folder)
            checkpoint.finish()
    return found


def check_curve(curve: LightCurve) -> None:
    """An InputError where there is nothing to fit."""
    if curve.geometry_only:
        raise InputError("the curve has no brightness to fit; add a column flux or mag")
    if curve.n_obs < 3:
        raise InputError(f"the curve has {curve.n_obs} points; at least 3 are needed to fit")
    if curve.kind == "flux":
        _check_level(curve)


def _check_level(curve: LightCurve) -> None:
    """An InputError where fluxes have no level to be in units of."""
    near = 1.0 if curve.range_km is None else curve.range_km**2
    for i, name in enumerate(curve.curve_names):
        here = curve.curve == i
        which = "the curve" if curve.n_curves == 1 else f"the curve {name}"
        if curve.free_scale[i] and not np.mean((curve.brightness * near)[here]) > 0:
            raise InputError(
                f"the mean flux of {which} is not positive, so that a scale cannot be found; leave "
                "the curve out, or give calibrated fluxes"
            )
        if curve.error is None and not np.any(curve.brightness[here]):
            raise InputError(
                f"every flux of {which} is 0 and there are no errors, so that a noise level cannot "
                "be found; leave the curve out, or give flux_err"
            )


def _attributes(
    curve: LightCurve, summary, entry: Entry, seed: int, options: Mapping[str, Any]
) -> dict[str, Any]:
    epoch = {}
    if curve.epoch_jd is not None:
        epoch["epoch_jd"] = curve.epoch_jd + curve.t.min() / 86400.0
    return epoch | {
        "model": printable(entry.name),
        "kind": curve.kind,
        "frame": curve.frame,
        "n_facets": summary["n_facets"],
        "seed": seed,
        "version": installed_version(),
        "command": "lcbayes fit --config run.toml",
        "source_file": str(curve.source.get("file", "")),
        "assumptions": json.dumps(_assumptions(curve, entry, options)),
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def _assumptions(curve: LightCurve, entry: Entry, options: Mapping[str, Any]) -> list[str]:
    """What the numbers rest on, in sentences."""
    from lcbayes.modelling.ephemeris import velocity_direction_sd_deg
    from lcbayes.physics.photometry import SUN_MAGNITUDE

    said, model = [], entry.name
    frame = FRAMES.get(curve.frame, curve.frame)
    if model in ("faceted", "faceted-brdf"):
        how = "that reflect diffusely and do" if model == "faceted" else "that do"
        said.append(f"The body is flat facets {how} not shade one another.")
        said.append(
            {
                "free": f"It turns at a constant angular velocity; its axes are {frame} at the "
                "start.",
                "none": f"It does not turn in {frame}.",
                "torque-free": "It is rigid and no torque acts on it; angular velocity and inertia "
                f"are those at the start, where its axes are {frame}.",
            }[str(options.get("spin", "free"))]
        )
    elif model == "convex-grid":
        said.append("The body is convex, and spins about a fixed axis of its own.")
        said.append(
            f"Its sidereal period is near {options['period']} h; other periods were not searched."
        )
    elif model == "stabilised":
        said.append("The body is flat facets that do not shade one another.")
        law = options.get("law", "yaw-steering")
        said.append(f"Its attitude follows the law {law}; normals are in the axes of that law.")
        if (unsure := velocity_direction_sd_deg(curve) or 0.0) > UNSURE_DEG:
            said.append(
                "Directions of flight, where a law asks for them, come from the places of the file "
                f"and are unsure by up to {unsure:.0f} deg; elements (--tle) give better ones."
            )
    if options:
        said.append("Options: " + ", ".join(f"{k} = {v}" for k, v in sorted(options.items())) + ".")
    if np.any(curve.free_scale):
        n = int(np.sum(curve.free_scale))
        said.append(f"The scale of {n} of {curve.n_curves} curves is unknown and inferred.")
    added = model == "stabilised" and options.get("scatter", 1.0)
    law = {o.name: o.default for o in entry.options.values()} | dict(options)
    law = str(law.get("noise_law", ""))
    said.append(
        "A scatter beyond the errors of the file is inferred."
        if curve.error is not None and added
        else "The errors of the file are taken as they are, independent"
        + (" and Gaussian." if law == "gaussian" else ".")
        if curve.error is not None
        else "The file has no errors; a noise level is inferred"
        + (" for each curve." if curve.n_curves > 1 and not added else ".")
    )
    said += [NOISE[law]] if law in NOISE else []
    unknown = sorted({str(b) for b in curve.band if str(b) and str(b) not in SUN_MAGNITUDE})
    if curve.kind == "mag" and unknown:
        said.append(f"The Sun's V magnitude was used for the band {', '.join(unknown)}.")
    if notes := curve.source.get("notes"):
        said.append(str(notes))
    return said
