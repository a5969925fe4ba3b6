"""Models by name or from a user's file, and the contract that both keep.

A model file is Python. It defines::

    SUMMARY = "one line for `lcbayes models`"

    def model(data, *, option: type = default, ...):
        ...                                  # NumPyro sites
        likelihood.observe(data, flux)       # conditions on the brightness

``data`` is a `lcbayes.modelling.epochs.Epochs`; ``likelihood`` is `lcbayes.modelling.likelihood`;
``flux`` (T,) is the flux at unit distance under unit irradiance.
Options are keyword-only, with a type and a default; one without a default must be given; a
``Literal`` type lists what may be chosen. The message of an `InputError` that the model raises is
shown to the user. Sites whose names the report knows (``albedo_area``, ``normals``, ``omega``,
``pole_lon_deg`` …) are shown as what they are. A file may also define:

``FACET_SITES``
    Names of the sampled sites whose first axis is the facet, so that facets can be put in order.
``starts(data, key, **options)``
    Constrained values of the sampled sites from which to search, a list of dicts; otherwise the
    search starts from the prior.
``NUM_STARTS``
    How many starts from the prior suffice, where the model has no ``starts``; otherwise it is
    chosen by the number of parameters.
``POOLED``
    Values of options with which solutions are sought, such as {"individuals": False}: a simpler
    model, whose sampled sites are some of this one's. What it finds is where the search for the
    solutions of this one starts, the other sites at their prior means.
``coordinates(data, **options)``
    Transforms for sampled sites in which the posterior is easier to sample, {site: Transform}.
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

from lcbayes.core.errors import InputError

BUILT_IN = ("faceted", "faceted-brdf", "convex-grid", "stabilised")


@dataclass(frozen=True)
class Option:
    """A keyword of a model."""

    name: str
    type: type
    default: Any  # inspect.Parameter.empty where it must be given
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
    def pooled(self) -> dict[str, Any]:
        return dict(getattr(self.module, "POOLED", {}))

    def hook(self, name: str) -> Callable[..., Any] | None:
        return getattr(self.module, name, None)

    @property
    def options(self) -> dict[str, Option]:
        found = {}
        for p in inspect.signature(self.model, eval_str=True).parameters.values():
            if p.kind is inspect.Parameter.KEYWORD_ONLY:
                kind = p.annotation if isinstance(p.annotation, type) else type(p.default)
                choices = get_args(p.annotation) if get_origin(p.annotation) is Literal else ()
                found[p.name] = Option(p.name, kind, p.default, choices)
        return found

    def check(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """The options given, converted to their types.

        Raises
        ------
        InputError
            If one is unknown, has the wrong type, or is missing.
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
                raise InputError(f"model {self.name!r} has no option {name!r}; available: {listed}")
            checked[name] = _convert(self.name, known[name], value)
        for option in known.values():
            if option.required and option.name not in checked:
                flag = option.name.replace("_", "-")
                raise InputError(
                    f"model {self.name!r} needs {option.name!r}; give it with --{flag} "
                    f"(see `lcbayes models {self.name}`)"
                )
        return checked

    @contextmanager
    def blamed(self) -> Iterator[None]:
        """Faults of the model while it runs, told in one line.

        A user's file may fail in any way; a built-in model says with ValueError that an option
        is wrong, and any other fault of it is ours.
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
                f"{self.name}, line {_last_line(fault, Path(self.name))}: {_said(fault)}; "
                "the model must run on this light curve"
            ) from fault

    def bind(self, options: Mapping[str, Any]) -> Callable[[Any], Any]:
        return partial(self.model, **options)


def _convert(model: str, option: Option, value: Any) -> Any:
    if option.choices and value not in option.choices:
        raise InputError(
            f"option {option.name!r} of model {model!r} is {value!r}; "
            f"available: {', '.join(option.choices)}"
        )
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


def find(name: str) -> Entry:
    """A built-in model by its name, or the model in the file at that path.

    Raises
    ------
    InputError
        If there is none, or the file breaks the contract.
    """
    if name in BUILT_IN:
        return Entry(name, importlib.import_module(f"lcbayes.models.{name.replace('-', '_')}"))
    path = Path(name)
    if path.suffix != ".py" and not path.exists():
        raise InputError(
            f"unknown model {name!r}; available: {', '.join(BUILT_IN)}; "
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
    except (Exception, SystemExit) as fault:  # a user's file may fail in any way
        line = getattr(fault, "lineno", None) or _last_line(fault, path)
        raise InputError(
            f"{name}, line {line}: {_said(fault)}; the file must run as it is"
        ) from fault
    function = getattr(module, "model", None)
    if not callable(function):
        raise InputError(
            f"{name} defines no function model(data, *, ...); see `lcbayes models --contract`"
        )
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError) as fault:  # some of Python's own have none
        raise InputError(f"{name}: model has no signature ({_said(fault)}); use def") from fault
    kinds = [p.kind for p in signature.parameters.values()]
    if kinds.count(inspect.Parameter.POSITIONAL_OR_KEYWORD) != 1:
        raise InputError(
            f"{name}: model{signature} must take data alone by position and its "
            "options by keyword: def model(data, *, option=default)"
        )
    entry = Entry(name, module)
    try:
        options = entry.options.values()
    except Exception as fault:  # an annotation that names nothing
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
    """A fault's kind and message in one line."""
    return " ".join(f"{type(fault).__name__}: {fault}".split())


def _last_line(fault: BaseException, path: Path) -> int:
    trace, line = fault.__traceback__, 0
    while trace is not None:
        if Path(trace.tb_frame.f_code.co_filename).resolve() == path.resolve():
            line = trace.tb_lineno
        trace = trace.tb_next
    return line
