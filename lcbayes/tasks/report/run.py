"""`lcbayes.report`."""

from __future__ import annotations

from pathlib import Path

from lcbayes.results.result import Result
from lcbayes.tasks.load import load
from lcbayes.tasks.report.options import TASK, ReportOptions
from lcbayes.tasks.task import Context, task_function


@task_function(TASK)
def report(folder: str | Path, _: ReportOptions, __: Context) -> Result:
    """Write the report of a results folder again, from the folder alone.

    The data in the folder do not change; ``report.html``, ``figures/`` and the shape files are
    replaced.

    {parameters}

    Returns
    -------
    Result
        As from `lcbayes.load`.

    Raises
    ------
    InputError
        The folder holds no results, or results of a task whose figures are drawn only when it
        runs.

    Examples
    --------
    >>> import lcbayes
    >>> import tempfile
    >>> folder = tempfile.mkdtemp()
    >>> curve = lcbayes.simulate("one-facet", seed=1, out=f"{folder}/one.csv").data
    >>> few = dict(num_starts=8, num_warmup=10, num_samples=10, num_chains=2)
    >>> fit = lcbayes.fit(curve, n_facets=1, spin="none", out=f"{folder}/fit", report=False, **few)
    >>> lcbayes.report(f"{folder}/fit").folder.joinpath("report.html").is_file()
    True
    """
    result = load(folder)
    result.write_report()
    return result
