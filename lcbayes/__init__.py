"""lcbayes: Bayesian inversion of light curves of unresolved space objects.

``read`` a light curve, ``fit`` a model to it, ``compare`` numbers of facets, ``scan`` attitudes,
``predict`` brightness or do a ``batch`` of objects; ``load`` the results of any of them; see the
README.
"""

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lcbayes.core.errors import InputError as InputError
    from lcbayes.data.lightcurve import LightCurve as LightCurve
    from lcbayes.data.read import read as read
    from lcbayes.data.write import write as write
    from lcbayes.results.draws import weighted_draws as weighted_draws
    from lcbayes.results.light_curve import load_light_curve as load_light_curve
    from lcbayes.results.result import Result as Result
    from lcbayes.tasks.albedo_area.run import albedo_area as albedo_area
    from lcbayes.tasks.attitude_test.run import attitude_test as attitude_test
    from lcbayes.tasks.batch.result import Batch as Batch
    from lcbayes.tasks.batch.run import batch as batch
    from lcbayes.tasks.compare.result import Comparison as Comparison
    from lcbayes.tasks.compare.run import compare as compare
    from lcbayes.tasks.fit.result import Fit as Fit
    from lcbayes.tasks.fit.run import fit as fit
    from lcbayes.tasks.glints.run import glints as glints
    from lcbayes.tasks.load import load as load
    from lcbayes.tasks.look.run import look as look
    from lcbayes.tasks.observability.run import observability as observability
    from lcbayes.tasks.predict.result import Prediction as Prediction
    from lcbayes.tasks.predict.run import predict as predict
    from lcbayes.tasks.report.run import report as report
    from lcbayes.tasks.scan.result import Scan as Scan
    from lcbayes.tasks.scan.run import scan as scan
    from lcbayes.tasks.shape_match.run import shape_match as shape_match
    from lcbayes.tasks.simulate.run import simulate as simulate
    from lcbayes.tasks.single_facet.run import single_facet as single_facet
    from lcbayes.tasks.spin.run import spin as spin
    from lcbayes.tasks.survey.result import Survey as Survey
    from lcbayes.tasks.survey.run import survey as survey

_HOMES = {
    "Batch": "lcbayes.tasks.batch.result",
    "Comparison": "lcbayes.tasks.compare.result",
    "Fit": "lcbayes.tasks.fit.result",
    "InputError": "lcbayes.core.errors",
    "LightCurve": "lcbayes.data.lightcurve",
    "Prediction": "lcbayes.tasks.predict.result",
    "Result": "lcbayes.results.result",
    "Scan": "lcbayes.tasks.scan.result",
    "Survey": "lcbayes.tasks.survey.result",
    "albedo_area": "lcbayes.tasks.albedo_area.run",
    "attitude_test": "lcbayes.tasks.attitude_test.run",
    "batch": "lcbayes.tasks.batch.run",
    "compare": "lcbayes.tasks.compare.run",
    "fit": "lcbayes.tasks.fit.run",
    "glints": "lcbayes.tasks.glints.run",
    "load": "lcbayes.tasks.load",
    "load_light_curve": "lcbayes.results.light_curve",
    "look": "lcbayes.tasks.look.run",
    "observability": "lcbayes.tasks.observability.run",
    "predict": "lcbayes.tasks.predict.run",
    "read": "lcbayes.data.read",
    "report": "lcbayes.tasks.report.run",
    "scan": "lcbayes.tasks.scan.run",
    "shape_match": "lcbayes.tasks.shape_match.run",
    "simulate": "lcbayes.tasks.simulate.run",
    "single_facet": "lcbayes.tasks.single_facet.run",
    "spin": "lcbayes.tasks.spin.run",
    "survey": "lcbayes.tasks.survey.run",
    "weighted_draws": "lcbayes.results.draws",
    "write": "lcbayes.data.write",
}
__all__ = [
    "Batch",
    "Comparison",
    "Fit",
    "InputError",
    "LightCurve",
    "Prediction",
    "Result",
    "Scan",
    "Survey",
    "albedo_area",
    "attitude_test",
    "batch",
    "compare",
    "fit",
    "glints",
    "load",
    "load_light_curve",
    "look",
    "observability",
    "predict",
    "read",
    "report",
    "scan",
    "shape_match",
    "simulate",
    "single_facet",
    "spin",
    "survey",
    "weighted_draws",
    "write",
]


def _load_numpyro_if_begun() -> None:
    """ArviZ leaves an unloaded ``numpyro`` behind; a submodule imported through it loses names."""
    getattr(sys.modules.get("numpyro"), "__version__", None)


_load_numpyro_if_begun()


def __getattr__(name: str) -> Any:
    """Names are looked up when asked for, so that `import lcbayes` loads no JAX."""
    if name not in _HOMES:
        raise AttributeError(f"module 'lcbayes' has no attribute {name!r}")
    _load_numpyro_if_begun()
    return getattr(import_module(_HOMES[name]), name)
