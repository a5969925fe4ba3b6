"""Built-in models and models from user files, which follow the same contract.

A model file is a Python file that defines::

    SUMMARY = "one line for `lcbayes models`"

    def model(data, *, option: type = default, ...):
        ...                                  # NumPyro sites
        likelihood.observe(data, flux)       # conditions on the brightness

``data`` is a `lcbayes.modelling.epochs.Epochs`; ``likelihood`` is `lcbayes.modelling.likelihood`;
``flux`` (T,) is the flux at unit distance under unit irradiance.
Options are keyword-only arguments with a type and a default; an option without a default is
required. A ``Literal`` type lists the allowed values. The message of an `InputError` raised by the
model is shown to the user. The report recognises standard site names (``albedo_area``,
``normals``, ``omega``, ``pole_lon_deg`` …). A file may also define:

``FACET_SITES``
    Names of the sampled sites whose first axis is the facet, so that facets can be sorted.
``starts(data, key, **options)``
    Starting points of the search: a list of dicts of constrained values of the sampled sites. By
    default, the search starts from the prior.
``NUM_STARTS``
    Number of starts from the prior for a model without ``starts``. By default, it depends on the
    number of parameters.
``POOLED``
    Values of options that define a simpler model, such as {"individuals": False}, whose sampled
    sites are a subset of those of the full model. Its solutions are the starting points of the
    search with the full model; the other sites start at their prior means.
``KEPT``
    Names of options of ``POOLED`` that the search takes as they are if they are given, or if
    nothing that it finds without them explains the data.
``COARSER``
    Values of options, unless they are given, with which the model costs less and is less exact,
    for the search.
``RIVAL``
    Name of a built-in model that is fitted for comparison, from the spins that were found. Both
    have the sites ``pole_base`` and ``period_shift`` of `modelling.asteroids.spin`, and the rival
    has ``shapes``.
``shapes(data, **options)``
    Values of all sampled sites but those two, from which a search starts at a known spin.
``coordinates(data, **options)``
    Transforms {site: Transform} to coordinates in which the posterior is easier to sample; a tuple
    of sites has one together.
``resolved(options)``
    The options with the content of the files that they name, so that a result needs no other file.
``equivalents(**options)``
    Matrices {site: (n, n)} on unconstrained sites that change nothing, such as the rotations of a
    symmetric body; the identity first. One of them is sampled, and all count in the evidence.
``mirrored(normal, **options)``
    Matrices {site: (n, n)} of the reflection in the plane of Sun and observer, for directions in
    one plane of a normal (3,); None if the body has no reflection.
``search(problem, data, options, workers, progress, checkpoint)``
    A search of its own in place of starts from the prior; as `inference.spin_search`.
``shadows_left_out(draws, data, **options)``
    Changes of the flux (n, T) by shadows that the model leaves out although they can be computed,
    at n draws {site: value} of constrained values; None if there are none. A result that they would
    change is not trusted.
``shading(**options)``
    What shadows leave of each panel of a body, for `Problem`, if the model takes it from
    ``data.lit`` where that is given; None if there are none.
``constants(data, **options)``
    Arrays to store with the result, such as a fixed grid of normals.
"""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import math
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any, Literal, get_args, get_origin

from lcbayes.core.constants import HOUR_S
from lcbayes.core.durations import seconds
from lcbayes.core.errors import InputError
from lcbayes.core.text import closest
from lcbayes.modelling.options import function_name

PERIOD = "period"  # of models that take a number of hours: also text with a unit
BUILT_IN = ("faceted", "faceted-brdf", "convex-grid", "contact-binary", "stabilised", "body")


@dataclass(frozen=True)
class Option:
    """A keyword of a model."""

    name: str
    type: type
    default: Any  # inspect.Parameter.empty if required
    choices: tuple[str, ...] = ()

    @property
    def required(self) -> bool:
        return self.default is inspect.Parameter.empty


@dataclass(frozen=True)
class Entry:
    """A model with its module."""

    name: str
    module: ModuleType

    @property
    def model(self) -> Callable[..., Any]:
        return self.module.model

    @property
    def summary(self) -> str:
        return getattr(self.module, "SUMMARY", "")

    @property
    def facet_sites(self) -> tuple[str, ...]:
        return tuple(getattr(self.module, "FACET_SITES", ()))

    @property
    def rival(self) -> str:
        """Name of the model that is fitted for comparison, if there is one."""
        return getattr(self.module, "RIVAL", "")

    @property
    def pooled(self) -> dict[str, Any]:
        return dict(getattr(self.module, "POOLED", {}))

    def searched(self, options: Mapping[str, Any], *, faulty: bool = False) -> dict[str, Any]:
        """The options of the search: those that are given, and `pooled` unless they are kept.

        Those of ``KEPT`` are kept if they are given, or all if the data are ``faulty``.
        """
        kept = set(getattr(self.module, "KEPT", ()))
        kept = kept if faulty else kept & set(options)
        return {**options, **{k: v for k, v in self.pooled.items() if k not in kept}}

    @property
    def coarser(self) -> dict[str, Any]:
        return dict(getattr(self.module, "COARSER", {}))

    @property
    def replaced(self) -> tuple[str, ...]:
        """The sites whose priors are not those of the model; see `with_priors`."""
        return getattr(self.module, "REPLACED", ())

    @property
    def _file(self) -> Path:
        """The file in which the model is defined."""
        code = getattr(inspect.unwrap(self.model), "__code__", None)
        return Path(self.name) if code is None else Path(code.co_filename)

    def hook(self, name: str) -> Callable[..., Any] | None:
        return getattr(self.module, name, None)

    @property
    def options(self) -> dict[str, Option]:
        options = {}
        for p in inspect.signature(self.model, eval_str=True).parameters.values():
            if p.kind is inspect.Parameter.KEYWORD_ONLY:
                kind = p.annotation if isinstance(p.annotation, type) else type(p.default)
                choices = get_args(p.annotation) if get_origin(p.annotation) is Literal else ()
                options[p.name] = Option(p.name, kind, p.default, choices)
        return options

    def check(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """The given options, converted to their types.

        Raises
        ------
        InputError
            If an option is unknown, has the wrong type, or is missing.
        """
        known, checked = self.options, {}
        for name, value in given.items():
            if name not in known:
                if (name, "reflectance" in known) == ("law", True):
                    raise InputError(
                        f"model {self.name!r} has no attitude law; its reflectance law is chosen "
                        "with --reflectance"
                    )
                listed = ", ".join(known) or "none"
                raise InputError(
                    f"model {self.name!r} has no option {name!r}{closest(name, known)}; "
                    f"available: {listed}"
                )
            checked[name] = _convert(self.name, known[name], value)
        for option in known.values():
            if option.required and option.name not in checked:
                flag = option.name.replace("_", "-")
                raise InputError(
                    f"model {self.name!r} needs {option.name!r}; give it with --{flag} "
                    f"(see `lcbayes models {self.name}`)"
                )
        resolved = self.hook("resolved")
        return checked if resolved is None else resolved(checked)

    @contextmanager
    def blamed(self) -> Iterator[None]:
        """Context that converts errors of the running model to an `InputError` of one line.

        All exceptions of a user's file are converted. A built-in model raises ValueError for an
        invalid option; its other exceptions are bugs and propagate unchanged.
        """
        try:
            yield
        except InputError:
            raise
        except (Exception, SystemExit) as fault:
            if self.name in BUILT_IN:
                if not isinstance(fault, ValueError):
                    raise
                raise InputError(
                    f"model {self.name!r}: {fault} (options: `lcbayes models {self.name}`)"
                ) from fault
            raise InputError(
                f"{self.name}, line {_last_line(fault, self._file)}: {_said(fault)}; "
                "the model must run on this light curve"
            ) from fault

    def with_priors(self, priors: Mapping[str, Any]) -> Entry:
        """The model with other distributions at the named sites; see `with_priors`.

        Raises
        ------
        InputError
            The priors are no mapping of distributions.
        """
        from lcbayes.modelling.replaced_priors import with_priors

        if not isinstance(priors, Mapping):
            raise InputError(
                f"priors is of type {type(priors).__name__}; give a mapping of site names to "
                "NumPyro distributions, in Python"
            )
        changed = ModuleType(self.module.__name__)
        changed.__dict__.update(vars(self.module))
        changed.__dict__.update(model=with_priors(self.model, priors), REPLACED=tuple(priors))
        return Entry(self.name, changed)

    def bind(self, options: Mapping[str, Any]) -> Callable[[Any], Any]:
        return partial(self.model, **options)


def _convert(model: str, option: Option, value: Any) -> Any:
    if option.choices and value not in option.choices:
        raise InputError(
            f"option {option.name!r} of model {model!r} is {value!r}; "
            f"available: {', '.join(option.choices)}"
        )
    if (option.name, option.type) == (PERIOD, float) and isinstance(value, str):
        return seconds(value, default="h") / HOUR_S
    try:
        if option.type is bool and isinstance(value, str):
            return {"true": True, "false": False}[value.lower()]
        if option.type is int and float(value) != int(float(value)):
            raise ValueError
        if option.type is float and not math.isfinite(float(value)):
            raise ValueError
        return option.type(float(value)) if option.type is int else option.type(value)
    except (TypeError, ValueError, KeyError, OverflowError):
        raise InputError(
            f"option {option.name!r} of model {model!r} is {value!r}; "
            f"expected {option.type.__name__}"
        ) from None


def find(name: str | Callable[..., Any]) -> Entry:
    """The built-in model of a name, the model in the file at a path, or a function as a model.

    Raises
    ------
    InputError
        If the model does not exist or the file violates the contract.
    """
    if callable(name):
        return _of_function(name)
    if name in BUILT_IN:
        return Entry(name, importlib.import_module(f"lcbayes.models.{name.replace('-', '_')}"))
    path = Path(name)
    if path.suffix != ".py" and not path.exists():
        raise InputError(
            f"unknown model {name!r}{closest(name, BUILT_IN)}; available: {', '.join(BUILT_IN)}; "
            "or give a file: --model ./mine.py"
        )
    if not path.is_file():
        raise InputError(f"model file {name} does not exist; give the path of a Python file")
    spec = importlib.util.spec_from_file_location(f"lcbayes_user_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise InputError(f"model file {name} is no Python file; give one whose name ends in .py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as fault:  # a user's file may raise any exception
        line = getattr(fault, "lineno", None) or _last_line(fault, path)
        raise InputError(
            f"{name}, line {line}: {_said(fault)}; the file must run as it is"
        ) from fault
    if not callable(getattr(module, "model", None)):
        raise InputError(
            f"{name} defines no function model(data, *, ...); see `lcbayes models --contract`"
        )
    return _checked(Entry(name, module))


def _of_function(function: Callable[..., Any]) -> Entry:
    """A function as a model; the module in which it is defined may define the other hooks."""
    name = function_name(function)
    module = ModuleType(name)
    home = sys.modules.get(getattr(function, "__module__", ""))
    if home is not None and getattr(home, "model", None) is function:
        module.__dict__.update(vars(home))
        built_in = home.__name__.removeprefix("lcbayes.models.").replace("_", "-")
        if built_in in BUILT_IN:
            return find(built_in)
    module.__dict__["model"] = function
    return _checked(Entry(name, module))


def _checked(entry: Entry) -> Entry:
    """The entry, if its function takes the data by position and options by keyword."""
    name, function = entry.name, entry.model
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError) as fault:  # some of Python's built-ins have no signature
        raise InputError(f"{name}: model has no signature ({_said(fault)}); use def") from fault
    kinds = [p.kind for p in signature.parameters.values()]
    if kinds.count(inspect.Parameter.POSITIONAL_OR_KEYWORD) != 1:
        raise InputError(
            f"{name}: model{signature} must take data alone by position and its "
            "options by keyword: def model(data, *, option=default)"
        )
    try:
        options = entry.options.values()
    except Exception as fault:  # an annotation with an undefined name
        raise InputError(
            f"{name}: the types of model's options cannot be read: {_said(fault)}"
        ) from fault
    for option in options:
        if option.type not in (bool, int, float, str):
            raise InputError(
                f"{name}: the option {option.name!r} needs a type, one of bool, int, float, str: "
                f"def model(data, *, {option.name}: float = 1.0)"
            )
    return entry


def _said(fault: BaseException) -> str:
    """Type and message of an exception in one line."""
    return " ".join(f"{type(fault).__name__}: {fault}".split())


def _last_line(fault: BaseException, path: Path) -> int:
    trace, line = fault.__traceback__, 0
    while trace is not None:
        if Path(trace.tb_frame.f_code.co_filename).resolve() == path.resolve():
            line = trace.tb_lineno
        trace = trace.tb_next
    return line
