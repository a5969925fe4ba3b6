"""The best schedule for the next measurements of a scenario."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.errors import InputError
from lcbayes.data.lightcurve import LightCurve
from lcbayes.simulation.observability import planning
from lcbayes.simulation.observability.campaign import Campaign
from lcbayes.simulation.observability.targets import Target, of_unknowns
from lcbayes.simulation.scenarios.epochs import epochs
from lcbayes.simulation.scenarios.scenario import Scenario
from lcbayes.simulation.scenarios.viewing import Orbit

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Plan:
    """The schedule and the schedules with which it is compared.

    Attributes
    ----------
    target : Target
    criterion : "A" or "D"
    visits : rows of the light curve of each candidate visit
    schedule, even : best schedule, and one of as many visits at equal steps
    sites : best schedule of each site alone, if there are several sites
    even_needed : number of visits at equal steps that reach the error of ``schedule``, or None
    """

    target: Target
    criterion: str
    visits: list[NDArray[np.intp]]
    schedule: planning.Schedule
    even: planning.Schedule
    sites: dict[str, planning.Schedule]
    even_needed: int | None


def usable(scenario: Scenario) -> tuple[Scenario, list[str]]:
    """The scenario without its unobservable passes, and the reasons for their removal.

    Raises
    ------
    InputError
        If no pass is observable.
    """
    geometry = scenario.geometry
    if not isinstance(geometry, Orbit):
        return scenario, []
    kept, notes = [], []
    for one in geometry.passes:
        try:
            epochs(replace(geometry, passes=(one,)))
            kept.append(one)
        except InputError as fault:
            notes.append(f"{one.site.name or 'a site'}: {fault}")
    if not kept:
        raise InputError(notes[0])
    return replace(scenario, geometry=replace(geometry, passes=tuple(kept))), notes


def visits(curve: LightCurve, length_s: float) -> list[NDArray[np.intp]]:
    """Candidate visits: points of one site within ``length_s``, or single points if it is 0."""
    if length_s <= 0.0:
        return [np.array([i]) for i in range(curve.n_obs)]
    site = np.unique(curve.site, return_inverse=True)[1]
    block = np.floor((curve.t - curve.t[0]) / length_s)
    _, group = np.unique(np.stack([block, site]), axis=1, return_inverse=True)
    return [np.flatnonzero(group == g) for g in range(group.max() + 1)]


def from_prior(campaign: Campaign, target: str) -> tuple[Floats, Target]:
    """Factors of the measurements (1, T, S) and of the target, given only the prior."""
    return (campaign.jacobian * campaign.unknowns.prior_sd)[None], of_unknowns(
        campaign.unknowns, target
    )


def plan(
    factor: Floats,
    target: Target,
    curve: LightCurve,
    n: int,
    *,
    criterion: str = "A",
    visit_s: float = 0.0,
) -> Plan:
    """The n most informative visits for a target, with an even schedule and single sites.

    Parameters
    ----------
    factor : (K, T, S)
        From `from_prior` or `known.from_fit`.
    curve : LightCurve
        The epochs that can be observed.
    n : int
        Number of visits.
    visit_s : float
        Length of a visit; 0 for single measurements.
    """
    groups = visits(curve, visit_s)
    if not 0 < n <= len(groups):
        raise InputError(
            f"{n} visits are asked for, and {len(groups)} are possible; "
            f"give a number from 1 to {len(groups)}"
        )
    stacked = _stacked(factor, groups)
    regular = planning.given(stacked, target.factor, planning.even(len(groups), n))
    names = sorted(set(map(str, curve.site)))
    alone, starts = {}, []
    for name in names if len(names) > 1 else []:
        here = [g for g, rows in enumerate(groups) if str(curve.site[rows[0]]) == name]
        alone[name] = planning.best(stacked[:, here], target.factor, n, criterion)
        if len(here) >= n:
            starts.append(np.array(here)[alone[name].visits])
    schedule = planning.best(stacked, target.factor, n, criterion, starts)
    return Plan(
        target,
        criterion,
        groups,
        schedule,
        regular,
        alone,
        _even_needed(stacked, target.factor, float(schedule.sd[-1]), n),
    )


def _even_needed(stacked: Floats, targets: Floats, wanted: float, n: int) -> int | None:
    """Smallest number of visits at equal steps, at least n, that reaches an error."""
    for count in range(n, stacked.shape[1] + 1):
        if planning.sd_after(stacked, targets, planning.even(stacked.shape[1], count)) <= wanted:
            return count
    return None


def _stacked(factor: Floats, groups: list[NDArray[np.intp]]) -> Floats:
    """Factors by visit (K, G, k, S); short visits are padded with rows of zeros."""
    out = np.zeros((len(factor), len(groups), max(map(len, groups)), factor.shape[2]))
    for g, rows in enumerate(groups):
        out[:, g, : len(rows)] = factor[:, rows]
    return out
