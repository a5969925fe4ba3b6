"""Options that tasks pass on to models."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from lcbayes.core.options import Options, declared_options, option

PRIORS = "priors"  # option of every model, in Python only


def period(text: str) -> float | str:
    """A number of hours, or text with a unit, which the model reads."""
    try:
        return float(text)
    except ValueError:
        return text.strip()


@dataclass(frozen=True)
class ModelOptions(Options):
    """Options that most models share, and the additional options of a single model.

    A task accepts them together with its task options. None selects the default of the model.
    `lcbayes.modelling.registry.Entry.check` rejects options that the model does not have.

    Attributes
    ----------
    others : mapping
        Options of the model that are not declared here.
    """

    n_facets: int | None = option(
        None, low=1, help="number of facets, or of grid normals for convex-grid"
    )
    period: float | None = option(
        None,
        above=0.0,
        parse=period,
        metavar="P",
        help="sidereal period with its unit: 23.7s, 23.70+-0.02s, 20-30s; for asteroids a "
        "number alone too (hours)",
    )
    pole: tuple[float, float, float] | None = option(
        None,
        unit="deg",
        metavar="RA,DEC,RADIUS",
        help="region of the pole or its opposite, GCRS, for bodies that spin",
    )
    law: str | None = option(None, metavar="NAME", help="attitude law, for stabilised")
    reflectance: str | None = option(None, metavar="NAME", help="reflectance law")
    facets: str | None = option(
        None, metavar="LIST", help="facets of known normals, for stabilised: +z,array:+x~5"
    )
    body: str | None = option(
        None, metavar="NAME|FILE", help="known body, for body: box-wing, rocket-stage, my.toml"
    )
    noise_law: str | None = option(
        None, metavar="NAME", aliases=("--noise",), help="gaussian, student-t or mixture"
    )
    spin: str | None = option(
        None,
        metavar="KIND",
        help="free, none for a body that does not turn, torque-free; flat for a known body",
    )
    zero_point_sd: float | None = option(
        None,
        unit="mag",
        low=0.0,
        help="prior sd of the zero point of each site and night, if several; 0: none",
    )
    clock_sd: float | None = option(
        None, unit="s", low=0.0, help="prior sd of the clock of each site, if several; 0: none"
    )
    rate_drift_sd: float | None = option(
        None,
        low=0.0,
        help="prior sd of the relative change of rate over several passes; 0: none",
    )
    others: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    @classmethod
    def of(cls, given: Mapping[str, Any]) -> Self:
        """Options from a mapping; names that the task does not declare belong to the model."""
        known = declared_options(cls)
        own = {name: value for name, value in given.items() if name in known}
        others = {name: value for name, value in given.items() if name not in known}
        return dataclasses.replace(super().of(own), others=others)

    def files(self) -> dict[str, Path]:
        """The files among the options; that of a body too."""
        body = {} if self.body is None else {"body": Path(self.body)}
        return super().files() | {k: path for k, path in body.items() if path.suffix == ".toml"}

    @property
    def for_model(self) -> dict[str, Any]:
        """Options passed to the model."""
        shared = {name: getattr(self, name) for name in declared_options(ModelOptions)}
        if self.pole is not None:
            shared["pole"] = ",".join(f"{x:.12g}" for x in self.pole)
        return {name: value for name, value in shared.items() if value is not None} | dict(
            self.others
        )

    def as_dict(self) -> dict[str, Any]:
        """Names and values for ``run.toml``; distributions in words."""
        others = dict(self.others)
        if isinstance(others.get(PRIORS), Mapping):
            others[PRIORS] = [f"{k}: {_prior(v)}" for k, v in others[PRIORS].items()]
        return super().as_dict() | others


def _prior(prior: Any) -> str:
    """A distribution in words: its name and parameters."""
    names = getattr(prior, "arg_constraints", {})
    values = ", ".join(f"{k}={getattr(prior, k)}" for k in names if hasattr(prior, k))
    return f"{type(prior).__name__}({values})"


def function_name(function: Callable[..., Any]) -> str:
    """The name of a function that serves as a model."""
    return f"{getattr(function, '__module__', '')}.{getattr(function, '__qualname__', 'model')}"
