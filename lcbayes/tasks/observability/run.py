"""`lcbayes.observability`."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lcbayes.results.record import input_file
from lcbayes.simulation.observability import campaign_plan
from lcbayes.simulation.observability.campaign import campaign
from lcbayes.simulation.observability.linearity import MAX_NONLINEARITY, nonlinearity
from lcbayes.simulation.observability.measurements import measure
from lcbayes.simulation.observability.parameters import Unknowns
from lcbayes.simulation.observability.summary import Findings
from lcbayes.simulation.observability.trades import trades
from lcbayes.simulation.scenarios.scenario import Scenario, input_files, load
from lcbayes.tasks.observability import known
from lcbayes.tasks.observability.options import TASK, ObservabilityOptions
from lcbayes.tasks.observability.result import Observability
from lcbayes.tasks.task import Context, task_function


@task_function(TASK)
def observability(
    scenario: str | Path | Scenario, options: ObservabilityOptions, context: Context
) -> Observability:
    """Predict what the measurements of a scenario will determine, and plan which to take.

    The Fisher information F = Σ ∇f ∇fᵀ/σ² of all measurements gives the Cramér-Rao bounds
    √(F⁻¹)ᵢᵢ of the unknowns, and the combinations that remain undetermined. The bounds are exact
    if the brightness is linear in the unknowns; ``nonlinearity`` measures the deviation.

    {parameters}

    Returns
    -------
    Observability
        ``data`` is a `lcbayes.simulation.observability.summary.Findings`: gradients (T, 3) per rad
        in the body frame, Fisher information (P, P), bounds (P,). ``summary()`` has one row an
        unknown, with its unit.

    Raises
    ------
    InputError
        The scenario or an option is invalid, or nothing can be observed.

    References
    ----------
    Hinks, Linares & Crassidis 2013, AIAA GNC 2013-5005 (information of a measurement); Van Trees
    1968, Detection, Estimation and Modulation Theory I, sec. 2.4.3 (bounds with a prior).

    Examples
    --------
    >>> import lcbayes
    >>> result = lcbayes.observability("two-facet-spin", plan=3)
    >>> result.summary()["parameter"].tolist()[:3]
    ['omega_x', 'omega_y', 'omega_z']
    >>> len(result.tables()["schedule"])
    3
    """
    named = not isinstance(scenario, Scenario)
    result = Observability(_findings(load(scenario) if named else scenario, options, context))
    if named:
        files = input_files(scenario)
        result.record = {"scenario": str(scenario)} | {
            f"input.{name}": input_file(path) for name, path in files.items()
        }
    if options.posterior is not None:
        result.record["input.posterior"] = input_file(options.posterior / "posterior.nc")
    return result


def _findings(scenario: Scenario, options: ObservabilityOptions, context: Context) -> Findings:
    """The information of the measurements, what they leave undetermined, and the plan."""
    scenario, skipped = campaign_plan.usable(scenario)
    notes = list(skipped)
    steps = 4 if options.plan is None else 5
    with context.progress.stage("observability", steps, "steps") as track:
        measured = measure(scenario)
        track.advance(1, f"{measured.curve.n_obs} measurements")
        planned = campaign(Unknowns.of(scenario, options.unknown), measured)
        track.advance(1, f"{len(planned.unknowns.parameters)} unknowns")
        left = trades(planned, measured)
        track.advance(1, f"{len(left)} undetermined combinations")
        bent = nonlinearity(planned, measured)
        track.advance(1, f"{int(np.sum(bent > MAX_NONLINEARITY))} nonlinear unknowns")
        plan = None
        if options.plan is not None:
            if options.posterior is None:
                factor, wanted = campaign_plan.from_prior(planned, options.target)
            else:
                factor, wanted, more = known.from_fit(
                    options.posterior, measured, options.target, options.model
                )
                notes += more
            plan = campaign_plan.plan(
                factor,
                wanted,
                measured.curve,
                options.plan,
                criterion=options.criterion,
                visit_s=options.visit,
            )
            track.advance(1, f"{options.plan} visits of {len(plan.visits)}")
    return Findings(scenario, measured, planned, left, bent, plan, tuple(notes))
