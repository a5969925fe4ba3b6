"""A scenario judged: its measurements, their information, what stays open, what to take next."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from lcbayes.core.progress import Silent
from lcbayes.simulation.observability import campaign_plan
from lcbayes.simulation.observability.campaign import campaign
from lcbayes.simulation.observability.linearity import MAX_NONLINEARITY, nonlinearity
from lcbayes.simulation.observability.measurements import measure
from lcbayes.simulation.observability.parameters import USUAL, Unknowns
from lcbayes.simulation.observability.summary import Findings
from lcbayes.simulation.observability.trades import trades
from lcbayes.simulation.scenarios.scenario import Scenario
from lcbayes.tasks.observability import known


def judge(
    scenario: Scenario,
    unknown: Sequence[str] = USUAL,
    *,
    n_visits: int | None = None,
    target: str = "pole",
    criterion: str = "A",
    visit_s: float = 0.0,
    posterior: Path | None = None,
    progress: Silent | None = None,
) -> Findings:
    """All of `lcbayes observability`, for Python.

    Parameters
    ----------
    scenario : Scenario
        From `scenario.load`.
    unknown : groups of `parameters.GROUPS`
    n_visits : int, optional
        Plan that many.
    target, criterion, visit_s
        Of the plan: see `targets.of_unknowns` and `campaign_plan.plan`.
    posterior : path, optional
        Folder of a fit, whose draws say what is known so far; else the priors do.

    Raises
    ------
    InputError
        Something asked for is not there, or nothing can be observed.
    """
    progress = progress or Silent()
    scenario, skipped = campaign_plan.usable(scenario)
    notes = list(skipped)
    with progress.stage("observability", 5 if n_visits else 4, "steps") as track:
        measured = measure(scenario)
        track.advance(1, f"{measured.curve.n_obs} measurements")
        found = campaign(Unknowns.of(scenario, unknown), measured)
        track.advance(1, f"{len(found.unknowns.parameters)} unknowns")
        left = trades(found, measured)
        track.advance(1, f"{len(left)} combinations open")
        bent = nonlinearity(found, measured)
        track.advance(1, f"{int(np.sum(bent > MAX_NONLINEARITY))} beyond the linear")
        plan = None
        if n_visits:
            if posterior is None:
                factor, wanted = campaign_plan.from_prior(found, target)
            else:
                factor, wanted, told = known.from_fit(posterior, measured, target)
                notes += told
            plan = campaign_plan.plan(
                factor, wanted, measured.curve, n_visits, criterion=criterion, visit_s=visit_s
            )
            track.advance(1, f"{n_visits} visits of {len(plan.visits)}")
    return Findings(scenario, measured, found, left, bent, plan, tuple(notes))
