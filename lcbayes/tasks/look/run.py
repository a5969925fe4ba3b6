"""`lcbayes.look`."""

from __future__ import annotations

from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.spin.candidates import candidate_periods
from lcbayes.tasks.look.advice import advise
from lcbayes.tasks.look.description import describe
from lcbayes.tasks.look.options import TASK, LookOptions
from lcbayes.tasks.look.result import LookResult
from lcbayes.tasks.task import Context, task_function


@task_function(TASK)
def look(curve: LightCurve, options: LookOptions, context: Context) -> LookResult:
    """What a light curve holds, its candidate periods, and what could be asked of it.

    The first function for a new file. A path is read here with default options; give what
    `lcbayes.read` returns if others are needed. Directions to Sun and observer are not required
    (``lcbayes.read(path, geometry=False)``).

    {parameters}

    Returns
    -------
    LookResult
        ``summary()`` lists the commands that could be run, ``tables()`` also the passes and
        candidate periods. It is always trusted: it contains no inference.

    Raises
    ------
    InputError
        The light curve or an option is invalid, or there is no brightness.

    Examples
    --------
    >>> import lcbayes
    >>> curve = lcbayes.simulate("one-facet", seed=1).data
    >>> result = lcbayes.look(curve)
    >>> result.content["n_passes"]
    1
    """
    candidates = candidate_periods(
        curve, n_shuffles=options.shuffles, seed=options.seed, progress=context.progress
    )
    description = describe(curve)
    return LookResult(curve, description, candidates, advise(curve, description.facts, candidates))
