"""lcbayes: Bayesian inversion of light curves of unresolved space objects.

``read`` a light curve, ``fit`` a model to it, ``compare`` numbers of facets, ``scan`` attitudes or
do a ``batch`` of objects; see the README.
"""

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lcbayes.batching import Batch as Batch
    from lcbayes.batching import batch as batch
    from lcbayes.comparing import Comparison as Comparison
    from lcbayes.comparing import compare as compare
    from lcbayes.errors import InputError as InputError
    from lcbayes.fitting import Fit as Fit
    from lcbayes.fitting import fit as fit
    from lcbayes.io import read as read
    from lcbayes.io import write as write
    from lcbayes.lightcurve import LightCurve as LightCurve
    from lcbayes.scanning import Scan as Scan
    from lcbayes.scanning import scan as scan

_HOMES = {
    "Batch": "lcbayes.batching",
    "Comparison": "lcbayes.comparing",
    "Fit": "lcbayes.fitting",
    "InputError": "lcbayes.errors",
    "LightCurve": "lcbayes.lightcurve",
    "Scan": "lcbayes.scanning",
    "batch": "lcbayes.batching",
    "compare": "lcbayes.comparing",
    "fit": "lcbayes.fitting",
    "read": "lcbayes.io",
    "scan": "lcbayes.scanning",
    "write": "lcbayes.io",
}
__all__ = [
    "Batch", "Comparison", "Fit", "InputError", "LightCurve", "Scan", "batch", "compare", "fit",
    "read", "scan", "write",
]  # fmt: skip


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
