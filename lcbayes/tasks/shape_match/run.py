"""`lcbayes.shape_match`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from lcbayes.core.errors import InputError
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.separated import shape_match as method
from lcbayes.physics.bodies import mesh, shapes
from lcbayes.results.record import input_file
from lcbayes.tasks.shape_match.options import TASK, ShapeMatchOptions
from lcbayes.tasks.shape_match.result import ShapeMatchResult
from lcbayes.tasks.task import Context, task_function


@task_function(TASK)
def shape_match(
    curve: LightCurve, options: ShapeMatchOptions, context: Context
) -> ShapeMatchResult:
    """Compare the distribution of brightness with phase angle with those of candidate shapes.

    Each candidate is oriented at random at the observed phase angles. The Kolmogorov–Smirnov
    distance of the magnitudes and the energy distance in the plane of phase angle and magnitude are
    ranked among samples of the candidate; the p-value combines both tests (Bonferroni). The test is
    exact if orientations are random and independent.

    {parameters}

    Returns
    -------
    ShapeMatchResult
        ``data`` is a `lcbayes.inversion.separated.shape_match.ShapeMatch`: ``phase`` (n,) in rad,
        ``magnitude`` (n,) at unit distance relative to the median. ``summary()`` has one row a
        candidate.

    Raises
    ------
    InputError
        The light curve, a shape or an option is invalid.

    References
    ----------
    Hall et al. 2007, AMOS Conference, sec. 5 and fig. 3; Székely & Rizzo 2013, J. Stat. Plan.
    Inference 143, 1249 (energy distance).

    Examples
    --------
    >>> import lcbayes
    >>> curve = lcbayes.simulate("box-wing", seed=1).data
    >>> result = lcbayes.shape_match(curve, shape=["cube", "sphere"])
    >>> sorted(result.summary()["shape"])
    ['cube', 'sphere']
    """
    bodies, inputs = _candidates(options)
    surface = method.Surface(options.r_diff, options.r_spec, options.exponent)
    matched = method.shape_match(
        curve,
        bodies,
        surface=surface,
        level=options.level,
        seed=options.seed,
        progress=context.progress,
    )
    result = ShapeMatchResult(matched, curve, surface, options.seed)
    result.record = inputs
    return result


def _candidates(options: ShapeMatchOptions) -> tuple[dict[str, shapes.Body], dict[str, Any]]:
    """The bodies by name, and for the record the files of those read from files."""
    known = method.candidates()
    bodies, inputs = {}, {}
    for name in options.shape or known:
        if name in known:
            bodies[name] = known[name]
        elif Path(name).suffix.lower() == ".obj":
            stem = Path(name).stem
            if stem in bodies:
                raise InputError(f"two candidates are called {stem!r}; rename the file {name}")
            bodies[stem] = mesh.read_body(name)
            inputs[f"input.shape-{len(inputs) + 1}"] = {"name": stem, **input_file(name)}
        else:
            raise InputError(
                f"unknown shape {name!r}; available: {', '.join(known)}, or a file.obj"
            )
    return bodies, inputs
