"""The common structure of tasks: a declaration gives names and defaults to shell and Python.

``tasks/NAME/options.py`` declares the options and a `Task`; it imports little, so that the command
line starts quickly. ``tasks/NAME/run.py`` defines the function that `task_function` makes public,
and ``tasks/NAME/result.py`` defines its result.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import MISSING, dataclass, field
from functools import wraps
from inspect import Parameter, Signature
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from lcbayes.core.errors import InputError
from lcbayes.core.options import Option, Options, declared_options
from lcbayes.core.paths import as_path
from lcbayes.core.progress import Silent, reporter
from lcbayes.modelling.options import ModelOptions

if TYPE_CHECKING:
    from lcbayes.core.checkpoint import Checkpoint
    from lcbayes.data.lightcurve import LightCurve
    from lcbayes.results.result import Result
    from lcbayes.results.store import ResultsFolder

R = TypeVar("R")
MAX_PERIODS = 50.0  # longest period relative to the duration of the light curve
ASTEROIDS = ("convex-grid", "contact-binary")  # models with a period in hours
CURVE = "curve"  # name of the first parameter of tasks that take a light curve
# what a task writes: TEXT goes to standard output, results of SOURCE stay in the source's folder
FOLDER, REQUIRED_FOLDER, FILE, SOURCE, TEXT = "folder", "required", "file", "source", "text"


@dataclass(frozen=True)
class Task:
    """A task, as named on the command line and in the documentation.

    Attributes
    ----------
    name : name on the command line, such as "attitude-test"
    details : text of `--help` below the options: examples, conditions, files written
    options : the dataclass of its options
    source : name of its first argument: "curve", "scenario", "folder" or "catalogue"; "" if none
    source_help : one line about the source
    fully_lit : whether points in the Earth's penumbra are removed before the task starts
    geometry : whether it needs the directions to Sun and observer
    out : what it writes: `FOLDER`, `REQUIRED_FOLDER` (in Python too), `FILE`, `SOURCE` or `TEXT`
    prints : whether the command may be given without ``-o``; it then only prints its result
    out_help : one line about the output
    listing : what ``--list`` prints, if the task has that flag
    """

    name: str
    details: str
    options: type[Options]
    source: str = CURVE
    source_help: str = "light curve: CSV, ECSV, DAMIT, MMT-9, SCORE"
    fully_lit: bool = False
    geometry: bool = True
    out: str = FOLDER
    prints: bool = False
    out_help: str = "folder for the results; a run that was stopped goes on there"
    listing: Callable[[], str] | None = None

    @property
    def has_model_options(self) -> bool:
        """Whether it also takes options of models."""
        return issubclass(self.options, ModelOptions)

    @property
    def function(self) -> str:
        """Name of its function in Python."""
        return self.name.replace("-", "_")


@dataclass
class Context:
    """The context of a run, for its task.

    Attributes
    ----------
    progress : object that reports progress
    folder : the results folder, locked for this run, or None
    """

    progress: Silent
    folder: ResultsFolder | None = None
    _checkpoint: Checkpoint | None = field(default=None, repr=False)

    def checkpoint(self, identity: dict[str, Any]) -> Checkpoint:
        """The checkpoint of this run; ``identity`` is everything that determines its numbers."""
        from lcbayes.core.checkpoint import Checkpoint

        if self.folder is None:
            return Checkpoint(None, identity)
        self._checkpoint = self.folder.checkpoint(identity, self.progress.say)
        return self._checkpoint

    def finish(self) -> None:
        """Remove the checkpoint of the run once the result is written."""
        if self._checkpoint is not None:
            self._checkpoint.finish()


def task_function(task: Task) -> Callable[[Callable[..., R]], Callable[..., R]]:
    """Make ``run(source, options, context)`` the public function of a task.

    The function takes the source, then the options of the task by keyword, then ``out`` (a results
    folder), ``report`` (whether to write the page there too) and ``progress``. A path may be given
    instead of a light curve. In its docstring, a section on parameters generated from the
    declaration replaces a line ``{parameters}``.
    """

    def decorate(run: Callable[..., R]) -> Callable[..., R]:
        @wraps(run)
        def public(*args: Any, **given: Any) -> R:
            source, given = _bound(task, args, given)
            writing = {name: given.pop(name) for name in _writing(task) if name in given}
            options = task.options.of(given)
            return execute(task, run, source, options, **writing)

        public.__name__ = public.__qualname__ = task.function
        public.__signature__ = signature(task, run)  # pyright: ignore[reportAttributeAccessIssue]
        public.__doc__ = documented(task, run.__doc__ or "")
        public.__annotations__ = {}
        return public

    return decorate


def _bound(task: Task, args: tuple[Any, ...], given: dict[str, Any]) -> tuple[Any, dict[str, Any]]:
    """The source, and all other arguments by name."""
    options = declared_options(task.options)
    names = [task.source, *(n for n, o in options.items() if o.declared.positional)]
    if len(args) > len(names):
        raise TypeError(f"{task.function}() takes {', '.join(names)} by position, all else by name")
    for name, value in zip(names, args, strict=False):
        if name in given:
            raise TypeError(f"{task.function}() got {name!r} twice")
        given[name] = value
    if task.source not in given:
        raise TypeError(f"{task.function}() needs {task.source!r}")
    return given.pop(task.source), given


def execute(
    task: Task,
    run: Callable[..., Any],
    source: Any,
    options: Options,
    out: str | Path | None = None,
    report: bool = True,
    progress: Silent | bool | None = None,
) -> Any:
    """Run a task and write its result to ``out``; arguments as for its public function."""
    value = light_curve(source, task) if task.source == CURVE else path_like(source, task)
    # other tasks take the period as known, which may be long
    if task.source == CURVE and (task.has_model_options or hasattr(options, "period_range")):
        _check_period(options, value)
    context = Context(reporter(progress))
    out = None if out is None else as_path(out, "out")
    if task.out == REQUIRED_FOLDER and out is None:
        raise InputError(f"the results of {task.name} need a folder; give out=DIR")
    if out is None or task.out in (FILE, SOURCE):
        result = recorded(task, run(value, options, context), options, value)
        if out is not None:
            result.save(out)
        return result
    from lcbayes.results.store import results_folder

    with results_folder(out, task.name) as context.folder:
        result = recorded(task, run(value, options, context), options, value)
        if report:
            context.progress.say("drawing the report")
        result.write(context.folder, report=report)
        context.finish()
    return result


def _check_period(options: Options, curve: LightCurve) -> None:
    """Refuse periods, in hours, during which the light curve covers only a small part of a turn."""
    from lcbayes.core.constants import HOUR_S

    if getattr(options, "model", ASTEROIDS[0]) not in ASTEROIDS:
        return  # other models take a period with its unit
    span_s = float(curve.t.max() - curve.t.min())
    for name in ("period", "period_range"):
        given = getattr(options, name, None)
        if given is None or isinstance(given, str):  # text has its unit
            continue
        longest = max(given) if isinstance(given, tuple) else given
        if longest * HOUR_S > MAX_PERIODS * span_s:
            flag = f"--{name.replace('_', '-')}"
            raise InputError(
                f"{flag} is {longest:g} hours, and the light curve covers {span_s:.4g} s; give "
                f"hours ({longest:g} s are {longest / HOUR_S:.3g} hours), or more data"
            )


def recorded(task: Task, result: Result, options: Options, value: Any) -> Result:
    """The result with the record of its run; entries that the task itself records are kept."""
    from lcbayes.results.record import record_of

    if task.out != SOURCE:
        result.source = value
        result.record = record_of(task.name, options, task.source, value) | result.record
    return result


def light_curve(source: Any, task: Task) -> LightCurve:
    """The light curve, given directly or as a file or a fit, without penumbral points if the task
    requires it."""
    from lcbayes.data.earth_shadow import fully_lit
    from lcbayes.data.lightcurve import LightCurve
    from lcbayes.data.read import read

    if isinstance(source, str | Path):
        path = Path(source)
        source = fitted_curve(path) if path.is_dir() else read(path, geometry=task.geometry)
    if not isinstance(source, LightCurve):
        raise InputError(
            f"the light curve is of type {type(source).__name__}; give the path of a file, or "
            "what lcbayes.read returns"
        )
    if task.geometry and source.brightness_only:
        raise InputError(
            f"the light curve has no directions to Sun and observer, which {task.name} needs; "
            "lcbayes.look says what can be done without them"
        )
    return fully_lit(source) if task.fully_lit else source


def path_like(source: Any, task: Task) -> Any:
    """The source of a task that takes no light curve: a path, a name, or an object of lcbayes."""
    if isinstance(source, str | Path) or type(source).__module__.startswith("lcbayes."):
        return source
    raise InputError(f"the {task.source} is of type {type(source).__name__}; give a path or a name")


def fitted_curve(folder: Path) -> LightCurve:
    """The light curve stored in the results folder of a fit.

    Raises
    ------
    InputError
        The folder holds no fit, or a fit without its light curve.
    """
    from lcbayes.results.light_curve import load_light_curve
    from lcbayes.results.load import open_posterior

    with open_posterior(folder) as tree:
        return load_light_curve(tree)


def signature(task: Task, run: Callable[..., Any]) -> Signature:
    """The signature of the public function of a task."""
    parameters = [Parameter(task.source, Parameter.POSITIONAL_OR_KEYWORD)]
    for name, declared in declared_options(task.options).items():
        default = Parameter.empty if declared.default is MISSING else declared.default
        kind = Parameter.KEYWORD_ONLY
        if declared.declared.positional:
            kind = Parameter.POSITIONAL_OR_KEYWORD
        parameters.append(Parameter(name, kind, default=default))
    parameters.sort(key=lambda p: p.kind)
    for name, default in _writing(task).items():
        parameters.append(Parameter(name, Parameter.KEYWORD_ONLY, default=default))
    if task.has_model_options:
        parameters.append(Parameter("model_options", Parameter.VAR_KEYWORD))
    returned = inspect.signature(run).return_annotation
    return Signature(parameters, return_annotation=returned)


def documented(task: Task, doc: str) -> str:
    """The docstring with its section on parameters, generated from the declaration."""
    lines = ["Parameters", "----------", f"{task.source} : {_source_type(task)}"]
    lines.append(f"    {_capital(task.source_help)}.")
    for declared in declared_options(task.options).values():
        lines += [f"{declared.name} : {_type(declared)}", f"    {_sentence(declared)}"]
    for name in _writing(task):
        lines += _DESCRIBED.get(
            name, [f"{name} : path, optional", f"    {_capital(task.out_help)}."]
        )
    if task.has_model_options:
        lines += ["**model_options", "    Other options of the model; see `lcbayes models NAME`."]
    return inspect.cleandoc(doc).replace("{parameters}", "\n".join(lines))


_DESCRIBED = {
    "report": (
        "report : bool",
        "    Whether to write the figures and ``report.html`` there too. Default: True.",
    ),
    "progress": (
        "progress : bool or lcbayes.core.progress.Console, optional",
        "    Whether to show how far the run is. Default: only in a notebook.",
    ),
}


def _writing(task: Task) -> dict[str, Any]:
    """The parameters that determine where results are written, with their defaults."""
    out = {} if task.out == SOURCE else {"out": None}
    report = {} if task.out in (FILE, SOURCE) else {"report": True}
    return {**out, **report, "progress": None}


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _source_type(task: Task) -> str:
    return "LightCurve or path" if task.source == CURVE else "path"


def _type(declared: Option) -> str:
    name = "{" + ", ".join(map(repr, declared.declared.choices)) + "}"
    if not declared.declared.choices:
        name = "path" if declared.kind is Path else declared.kind.__name__
    if declared.repeated:
        name = f"sequence of {name}"
    return name + (", optional" if declared.optional else "")


def _sentence(declared: Option) -> str:
    d = declared.declared
    unit = f", {d.unit}" if d.unit else ""
    default = ""
    if not declared.required and declared.default is not None:
        default = f" Default: {declared.default!r}."
    return f"{_capital(d.help)}{unit}.{default}"
