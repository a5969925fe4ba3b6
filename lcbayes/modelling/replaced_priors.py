"""Priors of a model that the caller replaces."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from typing import Any

import numpyro.distributions as dist
from numpyro.primitives import Messenger

from lcbayes.core.errors import InputError


def with_priors(model: Callable[..., Any], priors: Mapping[str, Any]) -> Callable[..., Any]:
    """The model with other distributions at the named sites.

    A distribution of a single number applies to each element of the site. The sites are those that
    the model samples, which may differ from what it reports: `faceted` samples
    ``log_albedo_area``, for example.

    Parameters
    ----------
    model : callable
        A NumPyro model.
    priors : mapping of site names to NumPyro distributions

    Raises
    ------
    InputError
        A value is no distribution. When the model runs: it samples no site of that name, or the
        shape of the distribution differs.

    Examples
    --------
    >>> import numpyro
    >>> import numpyro.distributions as dist
    >>> def model():
    ...     return numpyro.sample("x", dist.Normal(0.0, 1.0).expand([3]).to_event(1))
    >>> other = with_priors(model, {"x": dist.Normal(5.0, 1e-9)})
    >>> numpyro.handlers.seed(other, 0)().round(3).tolist()
    [5.0, 5.0, 5.0]
    """
    for name, prior in priors.items():
        if not isinstance(prior, dist.Distribution):
            raise InputError(
                f"the prior of {name!r} is of type {type(prior).__name__}; give a NumPyro "
                "distribution, such as numpyro.distributions.Normal(0.0, 1.0)"
            )

    @functools.wraps(model)
    def replaced(*args: Any, **options: Any) -> Any:
        used = _Replaced(priors)
        with used:
            result = model(*args, **options)
        if missing := [name for name in priors if name not in used.met]:
            listed = ", ".join(used.sites) or "none"
            raise InputError(f"the model samples no {missing[0]!r}; its sites: {listed}")
        return result

    return replaced


class _Replaced(Messenger):
    """Effect handler that exchanges the distributions of sampled sites."""

    def __init__(self, priors: Mapping[str, Any]) -> None:
        super().__init__()
        self.priors = priors
        self.met: set[str] = set()
        self.sites: list[str] = []

    def process_message(self, msg: dict[str, Any]) -> None:
        if msg["type"] != "sample" or msg["is_observed"]:
            return
        name = msg["name"]
        self.sites.append(name)
        if name in self.priors:
            self.met.add(name)
            msg["fn"] = _fitting(name, self.priors[name], msg["fn"])


def _fitting(name: str, prior: Any, old: Any) -> Any:
    """The distribution in the shape of the one that it replaces."""
    if prior.shape() == old.shape():
        events = len(old.event_shape) - len(prior.event_shape)
        return prior.to_event(events) if events > 0 else prior
    if prior.shape() == ():
        wide = prior.expand(old.shape())
        return wide.to_event(len(old.event_shape)) if old.event_shape else wide
    raise InputError(
        f"the prior of {name!r} has shape {prior.shape()}; expected {old.shape()}, or a "
        "distribution of one number"
    )
