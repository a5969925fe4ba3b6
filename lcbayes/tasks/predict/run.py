"""`lcbayes.predict`."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import xarray as xr

from lcbayes.core.errors import InputError
from lcbayes.core.reasons import Reason
from lcbayes.data.formats.occultation import read_occultations
from lcbayes.data.lightcurve import LightCurve
from lcbayes.data.read import read_geometry
from lcbayes.modelling import registry
from lcbayes.results.asteroid import asteroids
from lcbayes.results.draws import weighted_draws
from lcbayes.results.light_curve import load_light_curve
from lcbayes.results.load import open_posterior, read_summary
from lcbayes.results.reasons import reasons, stored
from lcbayes.results.record import read_record
from lcbayes.tasks.predict import outline, rotation
from lcbayes.tasks.predict.brightness import predicted
from lcbayes.tasks.predict.options import TASK, PredictOptions
from lcbayes.tasks.predict.outline_result import OutlinePrediction
from lcbayes.tasks.predict.result import Prediction
from lcbayes.tasks.predict.rotation import RotationPrediction
from lcbayes.tasks.task import Context, task_function


class Fitted(NamedTuple):
    """The content of a results folder that a prediction needs.

    Attributes
    ----------
    posterior : equally weighted draws
    curve : the fitted light curve
    model : a name, or the path of a file that the caller gave
    options : options of the model, already checked
    reasons : reasons not to trust the fit; empty if it is trusted
    """

    posterior: xr.Dataset
    curve: LightCurve
    model: str
    options: dict[str, Any]
    reasons: list[Reason]


@task_function(TASK)
def predict(
    folder: str | Path, options: PredictOptions, context: Context
) -> Prediction | RotationPrediction | OutlinePrediction:
    """Brightness, rotation or outline that a fit predicts.

    The folder of the fit contains everything needed; the light curve is not read again. Give one
    of a file with epochs and geometry, dates, and an occultation.

    {parameters}

    Returns
    -------
    Prediction, RotationPrediction or OutlinePrediction
        ``summary()`` has one row per epoch, per date and solution, or per solution; it is trusted
        if the fit is trusted.

    Raises
    ------
    InputError
        The folder holds no fit, the two curves are not compatible, or the model of the fit is a
        file that was not given or has changed; dates or an occultation are given for a fit that
        is not of an asteroid.

    Examples
    --------
    >>> import lcbayes
    >>> import tempfile
    >>> folder = tempfile.mkdtemp()
    >>> curve = lcbayes.simulate("one-facet", seed=1, out=f"{folder}/one.csv").data
    >>> few = dict(num_starts=8, num_warmup=10, num_samples=10, num_chains=2)
    >>> fit = lcbayes.fit(curve, n_facets=1, spin="none", out=f"{folder}/fit", report=False, **few)
    >>> result = lcbayes.predict(f"{folder}/fit", f"{folder}/one.csv")
    >>> result.trusted, len(result.summary())    # 20 draws are too few
    (False, 102)
    """
    asked = (options.geometry, options.date or None, options.occultation)
    if sum(x is not None for x in asked) != 1:
        raise InputError(
            "give one of: a file with epochs and geometry, --date JD, --occultation FILE"
        )
    if options.geometry is None:
        return _of_asteroid(Path(folder), options, context)
    fit = load_fit(Path(folder), options.model)
    wanted = read_geometry(options.geometry, tle=options.tle, site=options.site)
    columns, notes = predicted(
        fit.posterior, fit.curve, wanted, fit.model, fit.options, options.seed
    )
    if wanted.epoch_jd is None:
        times = {"t": wanted.t}
    else:
        times = {"jd": wanted.epoch_jd + wanted.t / 86400}
    curves = [wanted.curve_names[i] for i in wanted.curve]
    return Prediction({**times, "curve": curves, **columns}, notes, fit.reasons)


def _of_asteroid(
    folder: Path, options: PredictOptions, context: Context
) -> RotationPrediction | OutlinePrediction:
    """The rotation at dates, or the outline over chords."""
    events = [] if options.occultation is None else read_occultations(options.occultation)
    with open_posterior(folder) as tree:
        solutions = asteroids(tree)
    rotation.check(solutions, folder)
    against = stored(read_summary(folder))
    if options.occultation is None:
        return RotationPrediction(rotation.rotations(solutions, options.date), against)
    outlines = outline.outlines(solutions, events, options.num_bodies, context.progress)
    content = outline.content(outlines, events, str(options.occultation), options.seed)
    return OutlinePrediction(
        outlines, events, content, [*against, *reasons(outline.findings(outlines))]
    )


def load_fit(folder: Path, model: str | None = None) -> Fitted:
    """Load a fit from its folder alone.

    Parameters
    ----------
    model : the model file, if the fit's model is a file; a file named in the folder is never run

    Raises
    ------
    InputError
        The folder holds no fit or cannot be read, or the model file is missing or a different one.
    """
    with open_posterior(folder) as tree:
        seed = int(tree.attrs.get("seed", 0))
        posterior = weighted_draws(tree["posterior"].to_dataset(), seed=seed)
        curve = load_light_curve(tree)
    record = read_record(folder / "run.toml")
    if record.task != "fit":
        raise InputError(f"{folder} holds results of lcbayes {record.task}, not of a fit")
    name = record.model(model)
    entry = registry.find(name)
    summary = read_summary(folder)
    if not isinstance(given := summary.get("model_options"), dict):
        raise InputError(f"{folder / 'summary.json'} has no model_options; run `lcbayes fit` again")
    return Fitted(posterior, curve, name, entry.check(given), stored(summary))
