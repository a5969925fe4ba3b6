"""Options of tasks, declared once: type, unit, range, default and one line of help.

A task declares its options as a frozen dataclass with fields created by `option`::

    @dataclass(frozen=True)
    class SpinOptions(Options):
        shuffles: int = option(199, low=99, help="permutations of the test for periodicity")
        max_age: float = option(30.0, unit="days", above=0.0, help="oldest elements to accept")

The fields define the Python signature and its documentation, the command line, ``run.toml`` and
the columns of a catalogue. All values are checked when the object is created.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, Field, dataclass
from functools import cache
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Self, cast, get_args, get_origin, get_type_hints

from lcbayes.core.errors import InputError
from lcbayes.core.text import closest

_KEY = "option"
_BOOL = {"true": True, "false": False}
_EXPECTED = {int: "a whole number", float: "a number", bool: "true or false", str: "text"}


@dataclass(frozen=True)
class Declaration:
    """Properties of an option in addition to its type and default.

    Attributes
    ----------
    help : one line without a full stop
    unit : unit of the value, as printed
    low, high : inclusive bounds
    above, below : exclusive bounds
    choices : the values allowed
    metavar : the placeholder on the command line
    flag : name on the command line, if it differs from the field's name
    short : single letter on the command line
    aliases : further long options, with their leading dashes
    positional : whether it is a positional argument of the command line
    several : whether one long option takes several values, separated by spaces
    parse : converts the text of the command line or of ``run.toml`` to the value
    callables : whether a function may be given in Python
    """

    help: str
    unit: str = ""
    low: float | None = None
    high: float | None = None
    above: float | None = None
    below: float | None = None
    choices: tuple[str, ...] = ()
    metavar: str | None = None
    flag: str | None = None
    short: str | None = None
    aliases: tuple[str, ...] = ()
    positional: bool = False
    several: bool = False
    parse: Callable[[str], Any] | None = None
    callables: bool = False


def option(default: Any = MISSING, *, help: str, **declared: Any) -> Any:
    """A field of an options dataclass; `Declaration` lists the possible properties."""
    metadata = {_KEY: Declaration(help, **declared)}
    if isinstance(default, list | dict):
        factory = cast("Callable[[], Any]", default.copy)
        return dataclasses.field(default_factory=factory, metadata=metadata)
    return dataclasses.field(default=default, metadata=metadata)


@dataclass(frozen=True)
class Option:
    """One option: the name, type and default of its field, and its declared properties.

    Attributes
    ----------
    kind : int, float, bool, str or Path
    optional : whether None is allowed
    repeated : whether the value is a tuple of ``kind``
    length : number of values in that tuple (comma-separated in text); None for any number
    """

    name: str
    kind: type
    optional: bool
    repeated: bool
    default: Any
    declared: Declaration
    length: int | None = None

    @property
    def required(self) -> bool:
        return self.default is MISSING

    @property
    def flag(self) -> str:
        """The long option on the command line, or the placeholder of a positional argument."""
        if self.declared.positional:
            return self.placeholder
        return "--" + (self.declared.flag or self.name).replace("_", "-")

    @property
    def placeholder(self) -> str:
        """The placeholder of the value in the help."""
        d = self.declared
        choices = "{" + ",".join(d.choices) + "}" if d.choices else None
        name = self.name.upper() if d.positional else None
        return d.metavar or choices or name or {int: "N", float: "X"}.get(self.kind, "TEXT")

    @property
    def description(self) -> str:
        """Help text with the unit, the choices and the default."""
        d = self.declared
        notes = [d.unit] if d.unit else []
        if d.choices and d.metavar is not None:
            notes.append(f"one of {', '.join(d.choices)}")
        if not self.required and self.default not in (None, "", ()) and self.kind is not bool:
            shown = ",".join(map(str, self.default)) if self.repeated else self.default
            notes.append(f"default {shown}")
        return d.help + (f" ({'; '.join(notes)})" if notes else "")

    def check(self, value: Any) -> Any:
        """The value converted to the type of the option.

        Raises
        ------
        InputError
            It has the wrong type or lies outside the range.
        """
        if value is None and self.optional:
            return None
        if self.declared.callables and callable(value):
            return value
        if self.declared.parse is not None and isinstance(value, str):
            value = self.declared.parse(value)
            if not self.repeated and not isinstance(value, self.kind):
                return value
        if self.repeated:
            items = self._items(value)
            return tuple(self._one(v) for v in items)
        return self._one(value)

    def _items(self, value: Any) -> Sequence[Any]:
        if self.length is None:
            several = isinstance(value, tuple | list)
            return cast("Sequence[Any]", value) if several else (value,)
        given = value.split(",") if isinstance(value, str) else value
        try:
            items = [self._converted(item) for item in given]
        except (TypeError, ValueError, OverflowError):
            items = []
        if len(items) != self.length:
            unit = f" in {self.declared.unit}" if self.declared.unit else ""
            raise InputError(f"{self.flag} is {value!r}; expected {self.length} numbers{unit}")
        return items

    def _one(self, value: Any) -> Any:
        try:
            converted = self._converted(value)
        except (TypeError, ValueError, KeyError, OverflowError):
            expected = _EXPECTED.get(self.kind, "a path")
            raise InputError(
                f"{self.flag} is {_shown(value)}; expected {expected}{self._range()}"
            ) from None
        d = self.declared
        if d.choices and converted not in d.choices:
            raise InputError(
                f"{self.flag} is {value!r}{closest(str(value), d.choices)}; available: "
                f"{', '.join(d.choices)}"
            )
        outside = self.kind in (int, float) and not (
            (d.low is None or converted >= d.low)
            and (d.high is None or converted <= d.high)
            and (d.above is None or converted > d.above)
            and (d.below is None or converted < d.below)
        )
        if outside:
            expected = _EXPECTED[self.kind]
            raise InputError(f"{self.flag} is {_shown(value)}; expected {expected}{self._range()}")
        return converted

    def _converted(self, value: Any) -> Any:
        if self.kind is Path:
            return Path(value)
        if self.kind is bool:
            if isinstance(value, str):
                return _BOOL[value.lower()]
            if not isinstance(value, bool):
                raise TypeError
            return value
        if isinstance(value, bool) and self.kind in (int, float):
            raise TypeError
        if self.kind is int:
            number = int(value)
            if float(value) != number:
                raise ValueError
            return number
        if self.kind is float:
            number = float(value)
            if not math.isfinite(number):
                raise ValueError
            return number
        if not isinstance(value, str):
            raise TypeError
        return value

    def _range(self) -> str:
        """The range in words, with the unit."""
        d = self.declared
        unit = f" {d.unit}" if d.unit else ""
        if d.above is not None and d.below is not None:
            return f" between {d.above:g} and {d.below:g}{unit}"
        if d.above is not None:
            limit = f" and <= {d.high:g}" if d.high is not None else ""
            return f" > {d.above:g}{limit}{unit}"
        if d.low is not None and d.high is not None:
            return f" from {d.low:g} to {d.high:g}{unit}"
        if d.low is not None:
            return f" >= {d.low:g}{unit}"
        if d.high is not None:
            return f" <= {d.high:g}{unit}"
        return unit


def _shown(value: Any) -> str:
    """A value as shown in messages; numbers from the command line have no quotation marks."""
    try:
        float(value)
    except (TypeError, ValueError):
        return repr(value)
    return str(value)


class Options:
    """Base class of the options of a task: a frozen dataclass with fields created by `option`."""

    def __post_init__(self) -> None:
        for name, declared in declared_options(type(self)).items():
            object.__setattr__(self, name, declared.check(getattr(self, name)))

    @classmethod
    def of(cls, given: Mapping[str, Any]) -> Self:
        """Options from a mapping, e.g. from ``run.toml`` or a catalogue.

        Raises
        ------
        InputError
            A name is unknown, a required option is missing, or a value is invalid.
        """
        known = declared_options(cls)
        for name in given:
            if name not in known:
                raise InputError(
                    f"unknown option {name!r}{closest(name, known)}; available: {', '.join(known)}"
                )
        for name, declared in known.items():
            if declared.required and name not in given:
                raise InputError(f"{declared.flag} is missing; {declared.declared.help}")
        return cls(**given)

    def files(self) -> dict[str, Path]:
        """The files named by the options; for a results folder, its summary file."""
        named = {name: value for name, value in self.as_dict().items() if isinstance(value, Path)}
        return {k: v / "summary.json" if v.is_dir() else v for k, v in named.items()}

    def as_dict(self) -> dict[str, Any]:
        """Names and values, except values of None, for ``run.toml``."""
        values = {name: getattr(self, name) for name in declared_options(type(self))}
        return {name: v for name, v in values.items() if v is not None}


@cache
def declared_options(cls: type) -> dict[str, Option]:
    """The options of a dataclass by name, in the order of declaration."""
    hints = get_type_hints(cls)
    options: dict[str, Option] = {}
    for field in dataclasses.fields(cls):
        if _KEY in field.metadata:
            options[field.name] = _option(field, hints[field.name])
    return options


def _option(field: Field[Any], hint: Any) -> Option:
    optional = False
    if get_origin(hint) is UnionType:
        arguments = [a for a in get_args(hint) if a is not NoneType]
        optional = len(arguments) < len(get_args(hint))
        hint = arguments[0]
    repeated = get_origin(hint) is tuple
    items = get_args(hint)
    kind = items[0] if repeated else hint
    length = len(items) if repeated and Ellipsis not in items else None
    default = field.default
    if default is MISSING and field.default_factory is not MISSING:
        default = field.default_factory()
    return Option(field.name, kind, optional, repeated, default, field.metadata[_KEY], length)
