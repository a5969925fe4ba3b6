"""The content of ``summary.json`` of fits, comparisons, scans and batches, and its common part.

Each type is the verdict followed by the numbers of the task; the other tasks have theirs in
``result.py``. Angles are in degrees, areas in m² and times in s unless the name says otherwise.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NotRequired, TypedDict

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.reasons import ReasonContent

type Floats = NDArray[np.float64] | Sequence[float]


class Verdict(TypedDict):
    """The entries with which every summary begins."""

    schema: int
    task: str
    trusted: bool
    reasons: list[ReasonContent]


class ParameterContent(TypedDict):
    """Posterior of one parameter."""

    mean: float
    sd: float
    q05: float
    q50: float
    q95: float
    rhat: float
    ess_bulk: float
    ess_tail: float


class SpinMeans(TypedDict, total=False):
    """Means of the spin: those of `modelling.variables.SPIN` that the model has."""

    pole_lon_deg: float
    pole_lat_deg: float
    period_h: float
    omega_x_rad_s: float
    omega_y_rad_s: float
    omega_z_rad_s: float


class RunWeights(TypedDict, total=False):
    """The weight of a solution in each independent run, if there are several."""

    weight_by_run: Any


class BodyRow(TypedDict):
    """Posterior of a quantity of the body."""

    mean: float
    sd: float
    q05: float
    q50: float
    q95: float


class BodyContent(TypedDict):
    """Bodies of an asteroid: those constructed and those not, `results.asteroid.QUANTITIES`."""

    n_bodies: int
    n_failed: int
    quantities: dict[str, BodyRow]
    tilted: bool


class ModeContent(SpinMeans, RunWeights):
    """One solution."""

    weight: float
    weight_sd: float
    log_evidence: float
    log_evidence_se: float
    rms: float
    hits: int
    divergences: int
    max_rhat: float
    min_ess_bulk: float
    min_ess_tail: float
    parameters: dict[str, ParameterContent]
    body: NotRequired[BodyContent]


class ResidualTestContent(TypedDict):
    """A test of the residuals."""

    name: str
    statistic: float
    p_value: float
    upper_limit: bool  # of the p-value


class Residuals(TypedDict, total=False):
    """Tests of the residuals: limits of the p-values, and alternatives with their amounts."""

    false_alarm: float
    p_limit: float
    relative_p_limit: float
    even: bool
    kurtosis: float | None
    tests: list[ResidualTestContent]
    alternatives: list[dict[str, Any]]


class FitQuality(Residuals):
    """Goodness of fit of the heaviest solution, and predictive density of the posterior."""

    rms: float
    information_per_point: float
    rms_unit: str
    chi2: float | None
    dof: float
    elpd_loo: float
    elpd_se: float
    max_pareto_k: float
    log_evidence: float
    log_evidence_se: float


class OutlierTime(TypedDict, total=False):
    """The time of an outlier, if the light curve has absolute times."""

    utc: str


class OutlierSite(TypedDict, total=False):
    """The site of an outlier, if it has a name."""

    site: str


class Outlier(OutlierTime, OutlierSite):
    """A point that is probably an outlier."""

    row: int
    t: float
    curve: str
    probability: float
    residual: float


class Outliers(TypedDict, total=False):
    """The probable outliers, if the law of the noise has outliers."""

    outliers: list[Outlier]


class LatePasses(TypedDict, total=False):
    """Passes whose late times would look like the drift of the rate, if one is measured."""

    late_pass_instead: list[dict[str, Any]]  # `inference.late_pass.LatePass`


class Rivals(TypedDict, total=False):
    """Another body that was fitted for comparison."""

    rival: dict[str, Any]  # `results.rivals.content_of`


class FitTiming(TypedDict):
    """Seconds of each stage, and the number of gradients."""

    search_s: float
    compile_s: float
    warmup_s: float
    sampling_s: float
    gradients: int


class FitNumbers(Outliers, LatePasses, Rivals):
    """Numbers of a fit; ``parameters`` are those of the heaviest solution."""

    model: str
    n_facets: int
    n_obs: int
    seed: int
    max_rhat: float
    min_ess_bulk: float
    min_ess_tail: float
    divergences: int
    parameters: dict[str, ParameterContent]
    modes: list[ModeContent]
    fit: FitQuality
    rests_on: NotRequired[dict[str, dict[str, float]]]
    timing: FitTiming
    model_options: NotRequired[dict[str, Any]]
    sparse: NotRequired[dict[str, Any]]
    n_starts: int
    search: dict[str, Any] | None
    spins: NotRequired[list[dict[str, Any]]]  # `inference.spin_solutions.SpinSolution`
    notes: str
    identity: dict[str, Any]


class FitContent(Verdict, FitNumbers):
    """Content of the summary of `lcbayes.fit`."""


class CandidateContent(TypedDict):
    """One number of facets; `results.comparison.COLUMNS` describes the entries."""

    body: NotRequired[str]
    n_facets: int
    n_parameters: int
    log_evidence: float
    log_evidence_se: float
    log_evidence_spread: float
    log_evidences: Any
    log_prior_mass: float
    probability: float
    probability_q05: float
    probability_q95: float
    elpd_loo: float
    elpd_se: float
    elpd_diff: float
    elpd_diff_se: float
    max_pareto_k: float
    n_bad_pareto_k: int
    n_bounded: int
    stacking_weight: float
    chi2: float | None
    dof: float
    gradients: int
    seconds: float
    evidence_from: str
    chains_doubted: str
    reasons: list[ReasonContent]


class RuledOutContent(TypedDict):
    """A number of facets excluded by an upper bound on its evidence."""

    n_facets: int
    n_parameters: int
    log_evidence_below: float
    probability: float
    chi2: float | None
    dof: float


class CompareTiming(TypedDict):
    """Seconds of each stage, and the number of gradients."""

    search_s: float
    sampling_s: float
    gradients: int


class CompareNumbers(TypedDict):
    """Numbers of a comparison of numbers of facets."""

    model: str
    n_obs: int
    seed: int
    conclusion: str
    most_probable: int | str
    not_told_from_it: Sequence[int | str]
    not_excluded: Sequence[int | str]
    information_per_point: float
    weighed_at_n_facets: int | None
    weighed_at: NotRequired[str]
    n_runs: int
    candidates: list[CandidateContent]
    ruled_out: list[RuledOutContent]
    sparse: dict[str, Any] | None
    area_prior: dict[str, Any] | None
    timing: CompareTiming
    identity: dict[str, Any]


class CompareContent(Verdict, CompareNumbers):
    """Content of the summary of `lcbayes.compare`."""


class ScanSolution(TypedDict):
    """A spin, or a law of a stabilised attitude, with its fit."""

    law: str
    pole_lon_deg: NotRequired[float]
    pole_lat_deg: NotRequired[float]
    period_h: NotRequired[float]
    period_resolution_h: NotRequired[float]
    chi2: float
    rms: float
    near_equal: bool
    relation: str
    words: str
    hits: int
    coefficients: NotRequired[list[float]]
    probability: NotRequired[float]


class ScanParameter(TypedDict):
    """A quantity of the best spin; a scan gives no distribution."""

    mean: float
    sd: None
    q05: None
    q50: None
    q95: None


class ScanFit(TypedDict):
    """Goodness of fit of the best solution, and the limit of solutions that fit as well."""

    rms: float
    chi2: float
    dof: int
    chi2_near_equal: float
    sd_from_fit: bool


class NightAhead(TypedDict):
    """A night that could be observed; its start is in JD, or in seconds if no date is known."""

    night: int
    jd: NotRequired[float]
    t_s: NotRequired[float]
    n_points: int
    hours: float
    probability: float


class NightChosen(TypedDict):
    """The night chosen next, and the probability with all nights chosen so far."""

    night: int
    probability: float


class NightsAhead(TypedDict):
    """Expected probability of the true period after further nights."""

    now: float
    most: float
    error_mag: float
    nights: list[NightAhead]
    together: list[NightChosen]


class ScanNumbers(TypedDict):
    """Numbers of an attitude scan; ``modes`` are the solutions that fit as well as the best."""

    model: str
    n_facets: int
    n_obs: int
    seed: int
    frame: str
    n_hypotheses: int
    n_periods: int
    n_laws: int
    period_probability: float | None
    nights: NightsAhead | None
    laws_left_out: dict[str, str]
    reflectance: str
    body: str
    solutions: list[ScanSolution]
    parameters: dict[str, ScanParameter]
    modes: list[ScanSolution]
    fit: ScanFit
    timing: dict[str, float]


class ScanContent(Verdict, ScanNumbers):
    """Content of the summary of `lcbayes.scan`."""


class BatchNumbers(TypedDict):
    """Numbers of a batch; each object is a row of ``tables/objects.csv``."""

    catalogue: str
    n_objects: int
    n_trusted: int
    n_not_trusted: int
    n_failed: int
    n_done_before: int
    seconds: float
    objects_per_hour: float | None
    workers: str
    objects: list[dict[str, Any]]


class SurveyNumbers(TypedDict):
    """Numbers of a survey; each object and solution is a row of the table ``solutions``."""

    catalogue: str
    n_objects: int
    n_trusted: int
    n_not_trusted: int
    n_failed: int
    n_unique: int
    n_solutions: int
    n_done_before: int
    seconds: float
    seconds_per_object: float | None
    objects_per_hour: float | None
    workers: str
    failures: list[dict[str, Any]]


class SurveyContent(Verdict, SurveyNumbers):
    """Content of the summary of `lcbayes.survey`."""


class BatchContent(Verdict, BatchNumbers):
    """Content of the summary of `lcbayes.batch`."""
