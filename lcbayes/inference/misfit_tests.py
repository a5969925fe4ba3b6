"""Tests of the residuals of a fit, with p-values calibrated by simulation.

Under the model, linearised about the best fit, the residuals in units of their standard deviation
follow Normal(0, R) with R = I − J F⁻¹ Jᵀ; J is the Jacobian of the prediction over its sd and F the
information with the prior. Every statistic is computed for the observed residuals and for draws of
this distribution, so that each p-value is exact up to the number of draws, and so is the limit for
the smallest of several p-values, however they depend on each other.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter
from scipy.special import ndtri_exp

from lcbayes.core.jax_setup import jnp
from lcbayes.data.lightcurve import LightCurve
from lcbayes.data.observers import observers
from lcbayes.data.segments import APPARITION, PASS, split
from lcbayes.inference.alternatives import Alternative, alternatives, names_of
from lcbayes.inference.correlation import autocorrelation
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem, compiled, shaded

Floats = NDArray[np.float64]

FALSE_ALARM = 0.01  # probability that a fit of the correct model is refused by any of the tests
DRAWS, MAX_NUMBERS = 4000, 4e7  # draws of residuals; numbers of residuals in memory
STEP = 1e-3  # of differences, in posterior standard deviations
HARMONICS = 4  # of the rotational phase
ABSORBED = 1e-3  # share of the effect of an alternative that the parameters leave; below: none
LAGS = 4  # of the autocorrelation
KURTOSIS = "kurtosis"
MAX_FREQUENCIES = 64  # of the periodogram


class ResidualTest(NamedTuple):
    """A test of the residuals.

    Attributes
    ----------
    name : str
    statistic : float
    p_value : float
        At least 1/(draws + 1).
    upper_limit : bool
        Whether no drawn statistic was as large, so that the p-value is an upper limit.
    """

    name: str
    statistic: float
    p_value: float
    upper_limit: bool = False


class Explanation(NamedTuple):
    """An alternative with its amount.

    Attributes
    ----------
    name, about, unit, version : str
        As in `Alternative`; the version is the best-fitting one.
    amount, sd : float
        The amount and its standard deviation, sd including the correlation of the noise; for
        several amounts, the length of their vector.
    gain : float
        Decrease of chi2.
    p_value : float
        Of a gain as large for any version of this alternative.
    relative_p_value : float
        Of as large a share of chi2, which does not depend on the size of the errors.
    rough : bool
        Whether the amount is too large for the linear change of the brightness that it assumes.
    """

    name: str
    about: str
    unit: str
    version: str
    amount: float
    sd: float
    gain: float
    p_value: float
    relative_p_value: float = 0.0
    rough: bool = False


@dataclass(frozen=True)
class Examination:
    """Tests of the residuals of a fit.

    Attributes
    ----------
    tests : list of ResidualTest
    explanations : list of Explanation
        From the smallest p-value.
    limit : float
        The p-value below which one of these tests refuses the model: the model is refused by
        mistake with the probability `FALSE_ALARM`, whichever test does it. If the noise is
        inferred, the tests and their p-values are those of shares of chi2.
    relative_limit : float
        The same for the p-values of shares of chi2: if the errors of a correct model are too small
        by one factor, an alternative is taken for the cause with the probability `FALSE_ALARM`.
    even : bool
        Whether the residuals are white and Gaussian but for one factor, by the tests of shares of
        chi2 and by their kurtosis.
    kurtosis : float or None
        That of the residuals, n Σr⁴/(Σr²)², where it is larger than Gaussian noise of any size
        allows and no test of their order finds a pattern: there are outliers.
    """

    tests: list[ResidualTest]
    explanations: list[Explanation]
    limit: float
    relative_limit: float = 1.0
    even: bool = False
    kurtosis: float | None = None

    @property
    def refused(self) -> list[ResidualTest]:
        """The tests that the model fails, from the smallest p-value; chi2 first among equals."""
        return sorted((t for t in self.tests if t.p_value < self.limit), key=lambda t: t.p_value)

    @property
    def too_large(self) -> bool:
        """Whether chi2 is too large."""
        return any(t.name == "chi2" for t in self.refused)

    @property
    def cause(self) -> Explanation | None:
        """The alternative that explains the misfit best, if one is significant.

        If chi2 is too large, it must explain a significant share of it: errors that are too small
        enlarge the gain of every alternative.
        """
        good = [e for e in self.explanations if e.p_value < self.limit]
        if self.too_large:
            good = [e for e in good if e.relative_p_value < self.relative_limit]
        return max(good, key=lambda e: e.gain, default=None)


def errors_known(problem: Problem, data: Epochs) -> bool:
    """Whether the noise is that of the data; an inferred scatter makes any model fit."""
    return data.has_error and not {"sigma", "log_sigma"} & set(problem.names)


def residuals(problem: Problem, z: Floats, data: Epochs) -> Floats:
    """Residuals (T,) as quantiles of the normal distribution, Φ⁻¹(F(y)), given earlier points.

    For Gaussian noise they are (y − m)/σ.
    """
    here = shaded(problem, z, data)
    tails = np.asarray(compiled(problem.log_tail)(jnp.asarray(z), here))
    mean = np.asarray(compiled(problem.moments)(jnp.asarray(z), here).mean)
    return np.sign(np.asarray(data.brightness) - mean) * -ndtri_exp(tails)


def examine(
    problem: Problem,
    z: Floats,
    data: Epochs,
    curve: LightCurve,
    *,
    seed: int = 0,
    further: Sequence[Alternative] = (),
) -> Examination:
    """Test the residuals at the best fit z (D,).

    Parameters
    ----------
    problem, data
        ``data.information`` below 1 states that the noise is correlated. The draws then have the
        autocorrelation of the residuals, and it is not tested.
    curve : LightCurve
        The fitted curve.
    further : sequence of Alternative
        Beside those of `alternatives`.

    References
    ----------
    Westfall & Young 1993, Resampling-based Multiple Testing, sec. 2.3 (smallest p-value); Rao 1948,
    Proc. Camb. Phil. Soc. 44, 50 (score test).
    """
    seen_by = observers(curve)
    passes = split(curve.t, curve.curve * len(seen_by.names) + seen_by.index, PASS)
    n = int(np.clip(MAX_NUMBERS // curve.n_obs, 500, DRAWS))
    rng = np.random.default_rng([seed, 4])
    correlated = float(np.mean(np.asarray(data.information))) < 1.0
    seen = residuals(problem, z, data)
    noise = _noise(seen, passes, correlated, n, rng)
    maker = Projection.of(problem, z, data)
    drawn = maker.residuals(noise, rng)
    every = np.vstack([seen + maker.last_step(problem, z, data), drawn])

    statistics = _statistics(problem, z, data, curve, passes, correlated)
    values = {name: function(every) for name, function in statistics.items()}
    scores = []
    for one in (*alternatives(problem, z, data, names_of(curve)), *further):
        gains, best = _gains(one, every, maker)
        values[_code(one)] = gains
        scores.append((one, gains, best))
    # every statistic is quadratic in the residuals
    shares = {k: v / values["chi2"] for k, v in values.items() if k != "chi2"}
    tested = values if errors_known(problem, data) else dict(shares)
    p_values, limit = _p_values(tested)
    shares[KURTOSIS] = np.sum(every**4, axis=1) / values["chi2"] ** 2
    relative, relative_limit = _p_values(shares)
    even = min(float(p[0]) for p in relative.values()) >= relative_limit
    # What the model lacks makes heavy tails too, but in neighbouring points.
    apart = not correlated and all(relative[k][0] >= relative_limit for k in [*statistics][1:])
    heavy = apart and relative[KURTOSIS][0] < relative_limit
    kurtosis = seen.size * float(shares[KURTOSIS][0]) if heavy else None
    tests = [
        ResidualTest(k, float(v[0]), float(p_values[k][0]), bool(v[0] > v[1:].max()))
        for k, v in tested.items()
    ]
    explanations = [
        _explanation(one, best, every, maker)._replace(
            p_value=float(p_values[_code(one)][0]), relative_p_value=float(relative[_code(one)][0])
        )
        for one, _, best in scores
    ]
    explanations.sort(key=lambda e: (e.p_value, -e.gain))
    return Examination(tests, explanations, limit, relative_limit, even, kurtosis)


def _p_values(values: dict[str, Floats]) -> tuple[dict[str, Floats], float]:
    """p-values (1 + n,) of statistics (1 + n,), and the limit for the smallest of them."""
    if not values:
        return {}, 0.0
    p_values = {name: _ranks(value) for name, value in values.items()}
    smallest = np.min(np.stack(list(p_values.values())), axis=0)
    return p_values, float(np.quantile(smallest[1:], FALSE_ALARM))


def _code(one: Alternative) -> str:
    return f"{one.name} {one.about}".strip()


@dataclass(frozen=True)
class Projection:
    """The part of a change of the brightness that the parameters of the model do not absorb.

    Attributes
    ----------
    jacobian : (T, D)
        Of the prediction over its sd, by the parameters in units of the posterior's sd.
    covariance : (D, D)
        F⁻¹ in these units.
    prior_root : (D, D)
        A root P^(1/2) of the precision of the prior in these units.
    unit : (D,)
        The units, 1/√F_kk.
    power : float
        Mean power to which the likelihood of a point is raised.
    """

    jacobian: Floats
    covariance: Floats
    prior_root: Floats
    unit: Floats
    power: float

    @classmethod
    def of(cls, problem: Problem, z: Floats, data: Epochs) -> Projection:
        """At a point z (D,)."""
        power = float(np.mean(np.asarray(data.information)))
        fisher = np.asarray(compiled(problem.fisher)(jnp.asarray(z), data))
        prior = np.asarray(compiled(problem.prior_precision)(jnp.asarray(z), data))
        unit = 1.0 / np.sqrt(np.diag(fisher))
        sd = np.asarray(compiled(problem.moments)(jnp.asarray(z), data).sd)
        jacobian = np.empty((sd.size, len(z)))
        for k in range(len(z)):
            step = np.zeros(len(z))
            step[k] = STEP * unit[k]
            up, down = (
                np.asarray(compiled(problem.moments)(jnp.asarray(z + s), data).mean)
                for s in (step, -step)
            )
            jacobian[:, k] = (up - down) / (2.0 * STEP * sd)
        prior = prior * np.outer(unit, unit)
        values, vectors = np.linalg.eigh(prior)
        root = (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
        # the same Jacobian as in the residuals, so that R is a projection for a flat prior
        covariance = np.linalg.pinv(power * jacobian.T @ jacobian + prior, hermitian=True)
        return cls(jacobian, covariance, root, unit, power)

    def residuals(self, noise: Floats, rng: np.random.Generator) -> Floats:
        """Residuals (n, T) of fits to noise (n, T), with the truth drawn from the prior."""
        gain = self.power * self.covariance @ self.jacobian.T
        truth = rng.standard_normal((len(noise), len(self.covariance)))
        shift = truth @ self.prior_root @ self.covariance
        return noise - (noise @ self.jacobian) @ gain + shift @ self.jacobian.T

    def last_step(self, problem: Problem, z: Floats, data: Epochs) -> Floats:
        """Change (T,) of the residuals by a last step from z to the optimum.

        Alternatives that the parameters absorb almost fully would otherwise be misled.
        """
        slope = np.asarray(compiled(problem.slope)(jnp.asarray(z), data))
        return self.jacobian @ self.covariance @ (self.unit * slope)

    def left(self, columns: Floats) -> Floats:
        """R c for columns (..., T)."""
        gain = self.power * self.covariance @ self.jacobian.T
        return columns - (columns @ self.jacobian) @ gain


def _noise(
    seen: Floats, passes: list[NDArray[np.integer]], correlated: bool, n: int, rng
) -> Floats:
    """Noise (n, T) of unit variance, with the autocorrelation of the residuals if ``correlated``.

    Correlated noise is the sum of white noise and an Ornstein-Uhlenbeck process, sampled at the
    median step.
    """
    white = rng.standard_normal((n, seen.size))
    if not correlated:
        return white
    share, decay = _ornstein_uhlenbeck(seen, passes)
    noise = np.sqrt(1.0 - share) * white
    for rows in passes:
        own = rng.standard_normal((n, rows.size)) * np.sqrt(1.0 - decay**2)
        own[:, 0] /= np.sqrt(1.0 - decay**2)
        noise[:, rows] += np.sqrt(share) * lfilter([1.0], [1.0, -decay], own, axis=1)
    return noise


def _ornstein_uhlenbeck(seen: Floats, passes: list[NDArray[np.integer]]) -> tuple[float, float]:
    """Share of the variance and decay per step of ρ_k = share · decay^k, by least squares."""
    longest = max(rows.size for rows in passes)
    lags = np.arange(1, max(2, min(longest - 1, 60)))
    observed = autocorrelation(seen, passes, lags)
    share, decay = np.meshgrid(np.linspace(0.05, 1.0, 20), np.exp(-1.0 / np.geomspace(0.5, 60, 40)))
    shape = share[..., None] * decay[..., None] ** lags
    worst = np.sum(observed.pairs * (observed.rho - shape) ** 2, axis=-1)
    best = np.unravel_index(np.argmin(worst), worst.shape)
    return float(share[best]), float(decay[best])


def _statistics(
    problem: Problem,
    z: Floats,
    data: Epochs,
    curve: LightCurve,
    passes: list[NDArray[np.integer]],
    correlated: bool,
) -> dict[str, Callable[[Floats], Floats]]:
    """Functions of residuals (n, T), (n,) each; larger if the model is worse."""
    sites = compiled(problem.constrain)(jnp.asarray(z), data)
    statistics: dict[str, Callable[[Floats], Floats]] = {"chi2": lambda e: np.sum(e**2, axis=1)}
    observer = np.asarray(data.observer)
    if data.n_observers > 1:
        statistics["site"] = _means(
            [np.flatnonzero(observer == k) for k in range(data.n_observers)]
        )
    if len(passes) > 1:
        statistics["pass"] = _means(passes)
    if "period_h" in sites:
        apparitions = split(curve.t, curve.curve, APPARITION)
        if curve.n_curves < len(apparitions) < len(passes):
            statistics["apparition"] = _means(apparitions)
    phase = curve.phase_angle
    if np.ptp(phase) > 0.02:
        x = 2.0 * (phase - phase.min()) / np.ptp(phase) - 1.0
        statistics["phase angle"] = _projected(
            np.asarray(np.polynomial.legendre.legvander(x, 3)[:, 1:], float)
        )
    period = _period_s(sites)
    if period is not None and period < 0.9 * float(data.t_span):
        angle = 2.0 * np.pi * np.asarray(data.t)[:, None] / period * np.arange(1, HARMONICS + 1)
        statistics["rotational phase"] = _projected(np.hstack([np.cos(angle), np.sin(angle)]))
    if max(rows.size for rows in passes) > 2 * LAGS:
        if not correlated:
            statistics["autocorrelation"] = _autocorrelation(passes)
        statistics["periodogram"] = _periodogram(np.asarray(data.t), passes)
    return statistics


def _period_s(sites) -> float | None:
    if "period_h" in sites:
        return 3600.0 * float(sites["period_h"])
    rate = float(np.linalg.norm(sites["omega"])) if "omega" in sites else 0.0
    return 2.0 * np.pi / rate if rate else None


def _means(groups: list[NDArray[np.integer]]) -> Callable[[Floats], Floats]:
    """Sum over the groups of the squared sums, each over its number of points."""
    return lambda e: np.sum([e[:, g].sum(axis=1) ** 2 / len(g) for g in groups], axis=0)


def _projected(columns: Floats) -> Callable[[Floats], Floats]:
    """Squared length of the residuals along the space of the columns (T, K)."""
    basis = np.linalg.qr(columns)[0]
    return lambda e: np.sum((e @ basis) ** 2, axis=1)


def _autocorrelation(passes: list[NDArray[np.integer]]) -> Callable[[Floats], Floats]:
    """Largest standardised sum of the autocorrelations up to a lag."""

    def statistic(e: Floats) -> Floats:
        total, pairs, best = np.zeros(len(e)), 0, np.full(len(e), -np.inf)
        for lag in range(1, LAGS + 1):
            for rows in passes:
                if rows.size > lag:
                    total += np.sum(e[:, rows[lag:]] * e[:, rows[:-lag]], axis=1)
                    pairs += rows.size - lag
            best = np.maximum(best, total / np.sqrt(max(pairs, 1)))
        return best

    return statistic


def _periodogram(t: Floats, passes: list[NDArray[np.integer]]) -> Callable[[Floats], Floats]:
    """Largest power at any frequency, summed over the passes without regard to phase."""
    longest = max(float(np.ptp(t[rows])) for rows in passes)
    most = max(rows.size for rows in passes)
    count = max(2, min(MAX_FREQUENCIES, most // 2))
    frequency = np.arange(1, count + 1) / max(longest, 1e-300)

    def statistic(e: Floats) -> Floats:
        power = np.zeros((len(e), count))
        for rows in passes:
            angle = 2.0 * np.pi * t[rows][:, None] * frequency
            part = e[:, rows]
            power += ((part @ np.cos(angle)) ** 2 + (part @ np.sin(angle)) ** 2) * 2.0 / rows.size
        return power.max(axis=1)

    return statistic


def _gains(one: Alternative, every: Floats, maker: Projection) -> tuple[Floats, int]:
    """Largest standardised gain (n,) of any version, and the version for the first row."""
    gains = np.stack([_gain(columns, every, maker, one.one_sided) for columns in one.columns])
    # with correlated noise the gain of a slow version is larger by chance; its mean removes that
    typical = gains[:, 1:].mean(axis=1, keepdims=True)
    gains = gains / np.maximum(typical, 1e-12)
    return gains.max(axis=0), int(np.argmax(gains[:, 0]))


def _gain(columns: Floats, every: Floats, maker: Projection, one_sided: bool) -> Floats:
    """Decrease of chi2 (n,) by the best amounts of columns (K, T).

    If the amounts can only be positive, it is that by all of them, or by the best one alone.
    """
    information = columns @ maker.left(columns).T
    along = every @ columns.T
    if _absorbed(information, columns):
        return np.zeros(len(every))
    amounts = np.linalg.solve(information, along.T).T
    gain = np.sum(along * amounts, axis=1)
    if not one_sided:
        return gain
    alone = np.max(np.maximum(along, 0.0) ** 2 / np.diag(information), axis=1)
    return np.where(np.all(amounts > 0.0, axis=1), gain, alone)


def _absorbed(information: Floats, columns: Floats) -> bool:
    """Whether the parameters of the model have the same effect as the columns."""
    size = np.einsum("kt,kt->k", columns, columns)
    return bool(np.linalg.eigvalsh(information).min() <= ABSORBED * size.max())


def _explanation(one: Alternative, best: int, every: Floats, maker: Projection) -> Explanation:
    """The alternative with its amount, without p-values."""
    columns = one.columns[best]
    information = columns @ maker.left(columns).T
    if _absorbed(information, columns):
        return Explanation(one.name, one.about, one.unit, "", 0.0, np.inf, 0.0, 1.0, 1.0)
    amounts = np.linalg.solve(information, columns @ every.T)  # (K, 1 + n)
    amount = float(amounts[0, 0]) if len(columns) == 1 else float(np.linalg.norm(amounts[:, 0]))
    sd = float(np.sqrt(np.mean(np.var(amounts[:, 1:], axis=1))))
    gain = float(_gain(columns, every[:1], maker, one.one_sided)[0])
    version = one.labels[best]
    rough = abs(amount) > one.reach
    return Explanation(one.name, one.about, one.unit, version, amount, sd, gain, 1.0, 1.0, rough)


def _ranks(values: Floats) -> Floats:
    """p-value of each value among the drawn ones, values[1:]."""
    drawn = np.sort(values[1:])
    above = drawn.size - np.searchsorted(drawn, values, "left")
    return np.concatenate([(above[:1] + 1) / (drawn.size + 1), above[1:] / drawn.size])
