"""`lcbayes.predict`."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import xarray as xr

from lcbayes.core.errors import InputError
from lcbayes.core.reasons import Reason
from lcbayes.data.lightcurve import LightCurve
from lcbayes.data.read import read_geometry
from lcbayes.modelling import registry
from lcbayes.results.draws import weighted_draws
from lcbayes.results.light_curve import load_light_curve
from lcbayes.results.load import open_posterior, read_summary
from lcbayes.results.reasons import stored
from lcbayes.results.record import read_record
from lcbayes.tasks.predict.brightness import predicted
from lcbayes.tasks.predict.options import TASK, PredictOptions
from lcbayes.tasks.predict.result import Prediction
from lcbayes.tasks.task import Context, task_function


class Fitted(NamedTuple):
    """What a results folder holds of a fit, to predict from.

    Attributes
    ----------
    posterior : equally weighted draws
    curve : the light curve that was fitted
    model : a name, or the path of a file that the caller named
    options : of the model, checked
    reasons : against the fit; empty where it is trusted
    """

    posterior: xr.Dataset
    curve: LightCurve
    model: str
    options: dict[str, Any]
    reasons: list[Reason]


@task_function(TASK)
def predict(folder: str | Path, options: PredictOptions, _: Context) -> Prediction:
    """Brightness that a fit predicts for other epochs and geometries.

    The folder of the fit holds all that is needed: the light curve is not read again.

    {parameters}

    Returns
    -------
    Prediction
        ``summary()`` has one row an epoch; it is trusted where the fit is.

    Raises
    ------
    InputError
        The folder holds no fit, the two curves do not go together, or the model of the fit is a
        file and was not given, or has changed.

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


def load_fit(folder: Path, model: str | None = None) -> Fitted:
    """A fit from its folder alone.

    Parameters
    ----------
    model : the model file, where the fit's model is a file: none that the folder names is run

    Raises
    ------
    InputError
        The folder holds no fit, what `lcbayes fit` wrote there cannot be read, or the model file
        is missing or is another one.
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
