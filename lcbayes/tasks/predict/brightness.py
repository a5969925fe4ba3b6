"""Brightness predicted by a posterior at other epochs and geometries."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.data.lightcurve import LightCurve
from lcbayes.modelling import registry
from lcbayes.modelling.ephemeris import with_velocity
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.likelihood import PASS_SPREADS, STUDENT_T_DF, expected
from lcbayes.modelling.nuisances import OF_SERIES
from lcbayes.modelling.nutation import AMOUNTS, SD_DEG
from lcbayes.modelling.problem import Problem
from lcbayes.modelling.zero_points import SHARED

Floats = NDArray[np.float64]
QUANTILES = {"q05": 0.05, "q25": 0.25, "q75": 0.75, "q95": 0.95}
MOST_DRAWS = 1000
CHUNK = 2048  # epochs at a time, so that memory stays bounded


def predicted(
    posterior: xr.Dataset,
    fitted: LightCurve,
    wanted: LightCurve,
    model: str,
    options: Mapping[str, Any],
    seed: int = 0,
) -> tuple[dict[str, Floats], list[str]]:
    """Mean and central 50 % and 90 % intervals of the brightness that would be recorded.

    Parameters
    ----------
    posterior : xarray.Dataset
        Group ``posterior`` of a fit; for several solutions, equally weighted draws of it
        (`lcbayes.weighted_draws`).
    fitted : LightCurve
        The fitted curve; it sets the origin of time and the unit of brightness.
    wanted : LightCurve
        Epochs and geometry; its brightness is not used. Where it names no band, the band of the
        fitted curve applies.
    model, options
        As in the fit.
    seed : int
        Seed of the noise in the intervals.

    Returns
    -------
    columns : dict
        ``mag_mean``, ``mag_q05`` … or the same with ``flux_``, each (T,).
    notes : list of str
        Notes for the reader of the numbers.

    Notes
    -----
    If the fit had given errors, the noise is ``wanted.error`` if it is of the same kind of
    brightness, else the fitted curve's median error. If the noise was inferred, it is ``sigma``; if
    both apply, they are combined. The noise law is that of the fit. If points of a pass share an
    offset, the offset is drawn for a new pass. A curve of unknown scale is predicted with the scale
    of the fitted curve of the same name, or, if there is none, relative to its own mean.
    """
    mean, pick, own_level, notes = noise_free(posterior, fitted, wanted, model, options)
    sd = _noise(posterior, fitted, wanted, pick, mean.shape, own_level)
    if PASS_SPREADS[0] in posterior:  # the predicted passes are new ones
        level, drift = (posterior[k].values.reshape(-1)[pick][:, None] for k in PASS_SPREADS)
        elapsed = np.asarray(Epochs.of(wanted, fitted).passes.elapsed)
        shared = np.hypot(level, drift * elapsed) * _noise_unit(fitted, wanted, own_level)
        sd = np.hypot(sd, shared)
    if "correlated_sd" in posterior:
        size = posterior["correlated_sd"].values.reshape(-1)[pick][:, None]
        sd = np.hypot(sd, size * _noise_unit(fitted, wanted, own_level))
    entry = registry.find(model)
    noise_law = {o.name: o.default for o in entry.options.values()} | dict(options)
    law = noise_law.get("noise_law", "gaussian")
    rng = np.random.default_rng(seed)
    unit_noise = _unit_noise(law, posterior, pick, mean.shape, rng)
    if "zero_point" in posterior:
        typical = noise_law["zero_point_sd"]
        mean = _calibrated(mean, posterior, fitted, wanted, pick, typical, rng)
    drawn = mean + sd * unit_noise
    name = fitted.kind
    columns = {f"{name}_mean": mean.mean(axis=0)}
    for label, q in zip(
        QUANTILES, np.quantile(drawn, list(QUANTILES.values()), axis=0), strict=True
    ):
        columns[f"{name}_{label}"] = q
    return columns, notes


def _calibrated(
    mean: Floats,
    posterior: xr.Dataset,
    fitted: LightCurve,
    wanted: LightCurve,
    pick: NDArray[np.intp],
    zero_point_sd: float,
    rng: np.random.Generator,
) -> Floats:
    """The brightness (S, T) with zero points: that of the fitted site and night, or a new one.

    In a new night of a fitted site, the part that all nights of the site share is the fitted one.
    """

    def drawn(name: str, share: float) -> Floats:
        known = posterior[name].values.reshape(-1)[pick] if name in posterior else None
        sd = np.sqrt(share) * zero_point_sd if known is None else known
        return (sd * rng.standard_normal(len(pick)))[:, None]

    data, shared = Epochs.of(wanted, fitted), OF_SERIES in posterior
    known = posterior["zero_point"].values.reshape(-1, data.n_calibrations)[pick]
    new = drawn("calibration_sd", 1.0 - SHARED if shared else 1.0)
    series = np.asarray(data.series) if shared else np.zeros(wanted.n_obs, int)
    if shared:
        own = posterior[OF_SERIES].values.reshape(-1, data.n_series)[pick]
        new = new + np.concatenate([own, drawn("series_sd", SHARED)], axis=1)
    calibration = np.asarray(data.calibration)
    offset = np.pad(known, ((0, 0), (0, 1)))[:, calibration]  # −1: none
    offset = np.where(calibration == data.n_calibrations, new[:, series], offset)
    return mean + offset if fitted.kind == "mag" else mean * 10.0 ** (-0.4 * offset)


def noise_free(
    posterior: xr.Dataset,
    fitted: LightCurve,
    wanted: LightCurve,
    model: str,
    options: Mapping[str, Any],
) -> tuple[Floats, NDArray[np.intp], NDArray[np.bool_], list[str]]:
    """Brightness without noise at other epochs, for draws of a posterior; arguments of `predicted`.

    Returns
    -------
    mean : (S, T)
    pick : (S,)
        Indices of the draws, chains concatenated: all, or `MOST_DRAWS` evenly spaced.
    relative : (C,) bool
        Which curves of ``wanted`` are relative to their own mean because their scale is unknown.
    notes : list of str
    """
    wanted = with_velocity(wanted)  # from neighbouring points, which may be in another chunk
    wanted = _in_band(wanted, fitted)
    ready = Predictor.of(posterior, fitted, wanted, model, options)
    scale, own_level = ready.scales(posterior), ready.own_level
    parts = []
    for start in range(0, wanted.n_obs, CHUNK):
        rows = np.arange(start, min(start + CHUNK, wanted.n_obs))
        parts.append(
            _means(
                ready.problem,
                ready.sites,
                wanted.select(rows),
                fitted,
                scale[:, wanted.curve[rows]],
            )
        )
    mean = np.concatenate(parts, axis=1)
    if own_level.any():
        mean = _relative(mean, wanted, own_level, fitted.kind)
    return mean, ready.pick, own_level, ready.notes


@dataclass(frozen=True)
class Predictor:
    """The quantities needed to predict brightness at other epochs.

    Attributes
    ----------
    problem : Problem
        Problem of the fitted curve, whose `Epochs` are ``data``.
    sites : values of the model's sites at the draws, (S, …) each
    pick : (S,)
        Indices of the draws of the posterior, chains concatenated.
    source : (C,) int
        The fitted curve whose scale applies to each wanted curve; −1: the flux is absolute or, if
        `own_level`, relative to its own mean.
    own_level : (C,) bool
    notes : list of str
    """

    problem: Problem
    data: Epochs
    sites: dict[str, Floats]
    pick: NDArray[np.intp]
    source: NDArray[np.intp]
    own_level: NDArray[np.bool_]
    notes: list[str]

    @classmethod
    def of(
        cls,
        posterior: xr.Dataset,
        fitted: LightCurve,
        wanted: LightCurve,
        model: str,
        options: Mapping[str, Any],
        most: int = MOST_DRAWS,
    ) -> Predictor:
        """Arguments as for `predicted`; at most ``most`` draws, evenly spaced.

        Raises
        ------
        InputError
            The two curves are not compatible, or the fit is of an earlier version of the model.
        """
        if (fitted.range_km is None) != (wanted.range_km is None):
            raise InputError(
                "ranges are known for only one of the fitted curve and the epochs to predict; give "
                "range_km in both or in neither"
            )
        if wanted.frame != fitted.frame:
            raise InputError(
                f"the epochs to predict are in the frame {wanted.frame}, the fit in "
                f"{fitted.frame}; give both in one frame"
            )
        if (wanted.epoch_jd is None) != (fitted.epoch_jd is None):
            raise InputError(
                "only one of the fitted curve and the epochs to predict has absolute times; give "
                "utc or jd in both, or t (s) from the same origin in both"
            )
        data = Epochs.of(fitted)
        problem = Problem(registry.find(model).bind(options), data)
        count = posterior.sizes["chain"] * posterior.sizes["draw"]
        pick = np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int))
        shapes = jax.eval_shape(problem.constrain, np.zeros(problem.dim), data)
        needed = {k: shapes[k].shape for k in problem.names}
        if other := [
            k for k in needed if k not in posterior or posterior[k].shape[2:] != needed[k]
        ]:
            raise InputError(
                f"the fit has no {', '.join(other)} of the size that the model has for this light "
                "curve in this version of lcbayes; fit again"
            )
        names = [*problem.names, *({AMOUNTS} & set(posterior))]
        sites = {k: posterior[k].values for k in names}
        sites = {k: v.reshape(count, *v.shape[2:])[pick] for k, v in sites.items()}
        if AMOUNTS in sites:
            sites[AMOUNTS] = _with_new_night(sites[AMOUNTS], options)
        return cls(problem, data, sites, pick, *_sources(fitted, wanted))

    def scales(self, posterior: xr.Dataset) -> Floats:
        """Factor on the flux for each draw and wanted curve, (S, C)."""
        if np.all(self.source < 0):
            return np.ones((len(self.pick), len(self.source)))
        known = posterior["scale"].values.reshape(-1, len(self.data.level))[self.pick]
        known = known * np.asarray(self.data.level)
        return np.where(self.source >= 0, known[:, self.source], 1.0)

    def brightness(self, z: jax.Array, wanted: Epochs, curve: NDArray[np.intp]) -> jax.Array:
        """Noise-free brightness at one unconstrained vector of the problem, (T,); differentiable.

        ``wanted`` is from `epochs_of_known_scale`; ``curve`` (T,) is the curve of each epoch.
        """
        sites = self.problem.constrain(z, self.data)
        scale = jnp.ones(len(self.source))
        if np.any(self.source >= 0):
            scale = jnp.where(
                self.source >= 0, (sites["scale"] * self.data.level)[self.source], 1.0
            )
        drawn = {k: sites[k] for k in self.problem.names}
        return expected(wanted, self.problem.flux(drawn, wanted), scale[curve])


def _with_new_night(amounts: Floats, options: Mapping[str, Any]) -> Floats:
    """Nutation (S, nights + 1, 4), with a draw of the prior for a night without fitted points."""
    sd = float(options.get("nutation_sd", SD_DEG))
    new = sd * np.random.default_rng(0).standard_normal((len(amounts), 1, amounts.shape[-1]))
    return np.concatenate([amounts, new], axis=1)


def _means(
    problem: Problem, sites, wanted: LightCurve, fitted: LightCurve, scale: Floats
) -> Floats:
    """Noise-free brightness of every draw, (S, T)."""
    data = epochs_of_known_scale(wanted, fitted)

    def one(args):
        draw, s = args
        return expected(data, problem.flux(draw, data), s)

    return np.asarray(jax.jit(lambda a: jax.lax.map(one, a))((sites, scale)))


def epochs_of_known_scale(wanted: LightCurve, fitted: LightCurve) -> Epochs:
    """Epochs with one curve each, of known scale and errors. The scales of the draws are inserted
    directly, and the noise levels of the fitted curves, which differ in number, are not used."""
    each = jnp.ones(wanted.n_obs)
    return replace(
        Epochs.of(wanted, fitted),
        curve=jnp.arange(wanted.n_obs),
        level=each,
        noise_unit=each,
        error=each,
        has_error=True,
        free_scale=(False,) * wanted.n_obs,
    )


def _in_band(wanted: LightCurve, fitted: LightCurve) -> LightCurve:
    """The epochs, with the band of the fitted curve where they name none."""
    bands, unnamed = sorted(set(map(str, fitted.band))), wanted.band == ""
    if fitted.kind == "flux" or "" in bands or not unnamed.any():
        return wanted
    if len(bands) > 1:
        raise InputError(
            f"the fit is in the bands {', '.join(bands)}, and {int(unnamed.sum())} of the epochs "
            "to predict name none; give a column band"
        )
    return replace(wanted, band=np.where(unnamed, bands[0], wanted.band))


def _sources(
    fitted: LightCurve, wanted: LightCurve
) -> tuple[NDArray[np.intp], NDArray[np.bool_], list[str]]:
    """`Predictor.source`, `own_level` and notes."""
    source, own = np.full(wanted.n_curves, -1), np.zeros(wanted.n_curves, bool)
    if not np.any(fitted.free_scale):
        return source, own, []
    names = {n: i for i, n in enumerate(fitted.curve_names)}
    missing = []
    for j, name in enumerate(wanted.curve_names):
        i = names.get(name)
        if i is not None and (fitted.n_curves > 1 or wanted.n_curves == 1):
            source[j] = i
        elif np.all(fitted.free_scale):  # a calibrated curve would determine the body's size
            own[j] = True
            missing.append(name)
    notes = []
    if missing:
        listed = ", ".join(missing[:5]) + (" …" if len(missing) > 5 else "")
        notes.append(f"no fitted curve is named {listed}: relative to the mean of each curve")
    return source, own, notes


def _relative(mean: Floats, wanted: LightCurve, own, kind: str) -> Floats:
    """Curves of unknown scale relative to their mean: fluxes divided by it, magnitudes minus it."""
    mean = mean.copy()
    for j in np.flatnonzero(own):
        here = wanted.curve == j
        level = mean[:, here].mean(axis=1, keepdims=True)
        mean[:, here] = mean[:, here] / level if kind == "flux" else mean[:, here] - level
    return mean


def _unit_noise(law: str, posterior, pick, shape, rng: np.random.Generator) -> Floats:
    """Noise of unit scale by the law of a fit, (S, T)."""
    if law == "student-t":
        return rng.standard_t(STUDENT_T_DF, shape)
    drawn = rng.standard_normal(shape)
    if law != "mixture":
        return drawn
    share, width = (
        posterior[name].values.reshape(-1)[pick][:, None]
        for name in ("outlier_share", "outlier_width")
    )
    return np.where(rng.random(shape) < share, width, 1.0) * drawn


def _noise(posterior, fitted: LightCurve, wanted: LightCurve, pick, shape, own) -> Floats:
    """Standard deviation of the recorded brightness, (S, T).

    The noise level of a fit is relative to the mean of its curve; it is the same at every epoch,
    including dark ones.
    """
    given = None
    if wanted.error is not None and wanted.kind == fitted.kind:
        given = np.broadcast_to(wanted.error, shape)
    elif fitted.error is not None:
        unit = np.asarray(Epochs.of(fitted).noise_unit)
        relative = np.median(fitted.error / unit[fitted.curve])
        each = np.where(own, relative, np.median(fitted.error))
        given = np.broadcast_to(each[wanted.curve], shape)
    if given is not None and (fitted.error is None or "sigma" not in posterior):
        return given
    names = {n: i for i, n in enumerate(fitted.curve_names)}
    sigma = posterior["sigma"].values.reshape(-1)[pick][:, None]
    if "noise" in posterior:  # each fitted curve has its own level
        noise = posterior["noise"].values.reshape(-1, fitted.n_curves)[pick]
        known = [names.get(n) for n in wanted.curve_names]
        columns = [sigma[:, 0] if i is None else noise[:, i] for i in known]
        sigma = np.stack(columns, axis=1)[:, wanted.curve]
    inferred = sigma * _noise_unit(fitted, wanted, own)
    return inferred if given is None else np.hypot(given, inferred)


def _noise_unit(fitted: LightCurve, wanted: LightCurve, own: NDArray[np.bool_]) -> Floats:
    """The unit of the noise at each epoch, (T,): 1 for magnitudes and for curves relative to their
    own mean, else the mean of the fitted curve of that name, or of all."""
    unit = np.asarray(Epochs.of(fitted).noise_unit)
    known = dict(zip(fitted.curve_names, unit, strict=True))
    each = [known.get(name, unit.mean()) for name in wanted.curve_names]
    return np.where(own, 1.0, each)[wanted.curve]
