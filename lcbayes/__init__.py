"""lcbayes: Bayesian inversion of light curves of unresolved space objects.

``read`` a light curve, ``fit`` a model to it, ``compare`` numbers of facets, ``scan`` attitudes or
do a ``batch`` of objects; see the README.
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
    from lcbayes.tasks.batch.run import Batch as Batch
    from lcbayes.tasks.batch.run import batch as batch
    from lcbayes.tasks.compare.run import Comparison as Comparison
    from lcbayes.tasks.compare.run import compare as compare
    from lcbayes.tasks.fit.run import Fit as Fit
    from lcbayes.tasks.fit.run import fit as fit
    from lcbayes.tasks.scan.run import Scan as Scan
    from lcbayes.tasks.scan.run import scan as scan
    from lcbayes.tasks.spin.run import spin as spin

_HOMES = {
    "Batch": "lcbayes.tasks.batch.run",
    "Comparison": "lcbayes.tasks.compare.run",
    "Fit": "lcbayes.tasks.fit.run",
    "InputError": "lcbayes.core.errors",
    "LightCurve": "lcbayes.data.lightcurve",
    "Scan": "lcbayes.tasks.scan.run",
    "batch": "lcbayes.tasks.batch.run",
    "compare": "lcbayes.tasks.compare.run",
    "fit": "lcbayes.tasks.fit.run",
    "load_light_curve": "lcbayes.results.light_curve",
    "read": "lcbayes.data.read",
    "scan": "lcbayes.tasks.scan.run",
<<<<<<< HEAD
    "spin": "lcbayes.tasks.spin.run",
=======
    "weighted_draws": "lcbayes.results.draws",
>>>>>>> posterior
    "write": "lcbayes.data.write",
}
__all__ = [
    "Batch",
    "Comparison",
    "Fit",
    "InputError",
    "LightCurve",
    "Scan",
    "batch",
    "compare",
    "fit",
    "load_light_curve",
    "read",
    "scan",
<<<<<<< HEAD
    "spin",
=======
    "weighted_draws",
>>>>>>> posterior
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
