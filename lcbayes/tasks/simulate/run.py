"""`lcbayes.simulate`."""

from __future__ import annotations

from pathlib import Path

from lcbayes.results.record import input_file
from lcbayes.simulation import simulate as method
from lcbayes.simulation.scenarios.scenario import Scenario, input_files, load
from lcbayes.tasks.simulate.options import TASK, SimulateOptions
from lcbayes.tasks.simulate.result import Simulation
from lcbayes.tasks.task import Context, task_function


@task_function(TASK)
def simulate(
    scenario: str | Path | Scenario,
    options: SimulateOptions,
    context: Context,  # noqa: ARG001
) -> Simulation:
    """A noisy light curve of a scenario, with the truth from which it was generated.

    The flux is the sum over the facets that are lit and seen, dimmed in the Earth's penumbra if the
    scenario has an orbit; the noise is Gaussian.

    {parameters}

    Returns
    -------
    Simulation
        ``data`` is a `LightCurve` of T points: flux in W/m² if ranges are known, otherwise in m² at
        unit distance and irradiance, or magnitudes. ``truth`` holds what a perfect fit recovers.

    Raises
    ------
    InputError
        The scenario or an option is invalid, or the body is dark at all epochs.

    References
    ----------
    Linares & Crassidis 2018, eqs. (4), (5) and (31) (flux and geometry of the planar scenarios).

    Examples
    --------
    >>> import lcbayes
    >>> result = lcbayes.simulate("one-facet", seed=1)
    >>> result.data.n_obs, result.truth["seed"]
    (102, 1)
    """
    named = not isinstance(scenario, Scenario)
    curve, truth = method.simulate(load(scenario) if named else scenario, options.seed)
    result = Simulation(curve, truth)
    if named:
        files = input_files(scenario)
        result.record = {"scenario": str(scenario)} | {
            f"input.{name}": input_file(path) for name, path in files.items()
        }
    return result
