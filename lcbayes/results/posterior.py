"""The files of a fit: the posterior as an ArviZ DataTree, the summary, and the record."""

# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownArgumentType=false, reportUnknownVariableType=false
# (pandas, xarray, ArviZ and JAX come without complete types)
# pyright: reportUnknownParameterType=false, reportUnknownLambdaType=false

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from lcbayes.core.cluster import without_cluster
from lcbayes.core.files import write_atomic
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.version import installed_version
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inference.alternatives import names_of
from lcbayes.inference.fit import Mode, Posterior
from lcbayes.inference.loo import loo, without_tail
from lcbayes.inference.prior_mass import prior_sample
from lcbayes.modelling.constrained import constrain_draws, over_draws, without_epochs
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.likelihood import FLUX, OBSERVED, OUTLIER
from lcbayes.modelling.nuisances import INTEGRATED_OUT, drawn
from lcbayes.modelling.nutation import AMOUNTS
from lcbayes.modelling.problem import Problem, compiled, with_lit
from lcbayes.modelling.recorded import Sites
from lcbayes.modelling.registry import Entry
from lcbayes.modelling.variables import GROUPS, unit
from lcbayes.physics.bodies.lit import Lit
from lcbayes.results.draws import DARK, DARK_TIME, LOG_LIKELIHOOD, weighted_rows
from lcbayes.results.light_curve import light_curve_attributes, light_curve_variables
from lcbayes.samplers.chains import INVERSE_MASS

Floats = NDArray[np.float64]

# Axes of the variables that models record, after chain and draw.
AXES: dict[str, tuple[str, ...]] = {
    "albedo_area": ("facet",),
    "log_albedo_area": ("facet",),
    "phi": ("facet",),
    "g": ("facet",),
    "normals": ("facet", "xyz"),
    "normals_base": ("facet", "xyz"),
    "omega": ("axis",),
    "omega_unit": ("axis",),
    "scale": ("curve",),
    "log_level": ("level",),
    "noise": ("curve",),
    "noise_unit": ("curve",),
    "phase_a": ("phase_law",),
    "phase_d": ("phase_law",),
    "phase_k": ("phase_law",),
    "log_phase_a": ("phase_law",),
    "log_phase_d": ("phase_law",),
    "coefficients": ("coefficient",),
    "axis_ba": ("ellipsoid",),
    "axis_cb": ("ellipsoid",),
    "log_axis_ba": ("ellipsoid",),
    "log_axis_cb": ("ellipsoid",),
    "inertia": ("axis", "other_axis"),
    "inertia_base": ("shape",),
    "inertia_ratio": ("moment",),
    "area": ("facet",),
    "r_diff": ("facet",),
    "r_spec": ("facet",),
    "w": ("facet",),
    "nu": ("facet",),
    "n": ("facet",),
    "m": ("facet",),
    "member_offset": ("member",),
    "site_offset": ("site",),
    "zero_point": ("calibration",),
    "series_zero_point": ("series",),
    "clock_offset": ("observer",),
    "nutation": ("night", "nutation_component"),
    "log_nu": ("facet",),
    "log_n": ("facet",),
    "log_m": ("facet",),
}
STATS = {
    "potential_energy": "lp",
    "accept_prob": "acceptance_rate",
    "num_steps": "n_steps",
    "diverging": "diverging",
    "energy": "energy",
}
EXPECTED = "expected"  # the site of the brightness without noise
CURVES = 40  # draws of which the brightness without noise is stored
FACTORS = "factors"  # ln of the factors of a prior, besides the densities of its sites
METRIC = {
    "nuts": "Fisher information at the mean of the first draws, times a diagonal mass matrix",
    "facet-moves": "Fisher information at a point drawn proposal_scale posterior widths from each "
    "draw, in turn with moves of single facets",
    "guided": "that of nuts; along a cheaper density where that describes the posterior",
    "ahmc": "Fisher information at a point drawn proposal_scale posterior widths from each draw; "
    "where proposal_scale is inf, the inverse covariance of the warm-up",
    "ahmc-paper": "Fisher information at the start of each trajectory",
    "hmc": "inverse covariance of the warm-up",
    "rmhmc": "Fisher information, varying along each trajectory",
    "mh": "covariance of the warm-up, by which proposals are drawn",
    "smc": "Fisher information at an auxiliary point, for particles",
}


def dataset(draws: Mapping[str, NDArray[Any]]) -> xr.Dataset:
    """Draws {name: (C, S, ...)} with named axes."""
    variables = {}
    for name, values in draws.items():
        rank = values.ndim - 2
        axes = AXES.get(name, ())
        if len(axes) != rank:
            axes = tuple(f"{name}_{i}" for i in range(rank))
        variables[name] = (("chain", "draw", *axes), values)
    data = xr.Dataset(variables)
    letters = {d: list("xyz") for d in ("xyz", "axis") if data.sizes.get(d) == 3}
    ranges = {d: np.arange(n) for d, n in data.sizes.items() if d not in letters}
    return data.assign_coords({**ranges, **letters})


def tree(
    posterior: Posterior, curve: LightCurve, entry: Entry, options: Mapping[str, Any], seed: int
) -> xr.DataTree:
    """The DataTree of a fit.

    Groups
    ------
    posterior, sample_stats, log_prior, log_likelihood, posterior_predictive
        A row for each draw. The chains of all solutions follow one another along ``chain``, as
        they were sampled, so R-hat shows chains that disagree and solutions that do not mix.
        If some solutions have more draws than others, their last draws are in ``modes/k`` only.
        The coordinates ``solution`` and ``weight`` (chain) give the solution to which a chain
        belongs and the share of the posterior it represents. `lcbayes.weighted_draws` gives
        equally weighted draws, also of all these groups together.
    log_likelihood, log_likelihood_dark
        ln p(yᵢ|z) to the power of one for each point, with ``time`` the row of the point. At an
        epoch at which the body is dark, the likelihood is the same in every draw, or in every draw
        of the tail that PSIS smooths, and ArviZ raises an error. Such epochs are in
        ``log_likelihood_dark``, along ``dark_time``; all others are in ``log_likelihood``.
        Functions that also use epochs of other groups, such as ``az.loo_pit``, need
        ``tree.sel(time=tree.log_likelihood.time)``. Attributes of ``log_likelihood``: ``elpd_loo``
        and ``elpd_loo_se`` of all epochs by `lcbayes.inference.loo`; ``elpd_loo_dark``, the part
        from dark epochs; and ``information_per_point``, the power p of the likelihood in the
        posterior. ``az.loo(lcbayes.weighted_draws(tree)).elpd + elpd_loo_dark`` equals
        ``elpd_loo`` if p = 1; ArviZ does not support any other p.
    log_prior
        ln of the prior density of each site, in the model's own units, and of the ``factors``.
    prior
        Draws from the prior with all its factors; the attribute ``factors`` describes how.
    observed_data, constant_data
        The complete light curve: `lcbayes.load_light_curve`.
    modes/k
        ``posterior`` and ``sample_stats`` of each solution, with all its draws. If NUTS sampled
        it, ``sample_stats`` holds the inverse mass matrix of each chain, of the unconstrained
        coordinates before labels of facets were matched.
        ``curves`` holds the brightness without noise of the draw that fits best and of forty
        others, with their chains and draws.
    """
    problem, data = posterior.problem, posterior.data
    modes = posterior.modes
    length = min(m.z.shape[1] for m in modes)
    z = np.concatenate([m.z[:, :length] for m in modes])
    rng = np.random.default_rng([seed, 3])
    keys = jax.random.split(jax.random.fold_in(jax.random.key(seed), 1), len(modes))
    sites, *each = zip(
        *(_recorded(problem, m.z, data, k) for m, k in zip(modes, keys, strict=True)), strict=True
    )
    apart = [_with_names(dataset(drawn(one, rng)), curve, data) for one in sites]
    pointwise, replicated = (np.concatenate([x[:, :length] for x in of]) for of in each)
    chains = _chains(modes)
    whole = _stacked(apart, length).assign_coords(chains)
    point = {"time": np.arange(curve.n_obs)}
    points = xr.Dataset(coords={k: whole[k] for k in ("chain", "draw", *chains)} | point)
    time = ("chain", "draw", "time")
    rows = weighted_rows(whole, seed=seed)
    predicted = points.assign({OBSERVED: (time, replicated)})
    if (probability := _outliers(problem, z, data, rows)) is not None:
        predicted[OUTLIER] = (("time",), probability)
    groups: dict[str, xr.Dataset] = {
        "posterior": whole,
        "sample_stats": _stacked([_stats(m) for m in modes], length).assign_coords(chains),
        "log_prior": points.drop_vars("time").assign(_log_prior(problem, z, data)),
        **_log_likelihood(points.assign({OBSERVED: (time, pointwise)}), rows, data),
        "posterior_predictive": predicted,
        "prior": _prior(problem, data, seed),
        "observed_data": xr.Dataset({OBSERVED: (("time",), curve.brightness)}, point),
        "constant_data": _constants(curve, data, entry, options).assign_coords(point),
    }
    for name in ("posterior", "sample_stats"):
        groups[name].attrs = _sampling(posterior, modes)
    for i, mode in enumerate(modes):
        groups[f"modes/{i}/posterior"] = apart[i].assign_attrs(_sampling(posterior, [mode]))
        stats = _stats(mode).assign(_mass(problem, mode))
        groups[f"modes/{i}/sample_stats"] = stats.assign_attrs(_sampling(posterior, [mode]))
        if (curves := _curves(problem, mode, data)) is not None:
            groups[f"modes/{i}/curves"] = curves
    _add_units(groups, curve)
    return xr.DataTree.from_dict(groups | {"/": xr.Dataset(attrs=light_curve_attributes(curve))})


def _with_names(draws: xr.Dataset, curve: LightCurve, data: Epochs) -> xr.Dataset:
    """The draws with the names of the axes `GROUPS` as coordinates."""
    names, titles = names_of(curve), curve.curve_titles
    laws = ["calibrated curves"] if data.calibrated else []
    laws += [titles[k] for k in data.phased]
    groups = names["observers"], names["calibrations"], names["series"]
    every = (*groups, titles, laws, ("first", "second"))
    given = zip(GROUPS, map(list, every), strict=True)
    return draws.assign_coords({k: v for k, v in given if k in draws.dims})


def _add_units(groups: Mapping[str, xr.Dataset], curve: LightCurve) -> None:
    """Set the attribute ``units`` of every number; those of the log density and of the sampler are
    pure."""
    relative, magnitude = bool(np.all(curve.free_scale)), curve.kind == "mag"
    for name, group in groups.items():
        pure = name.split("/")[-1].startswith(("log_", "sample_stats"))
        for key, variable in group.data_vars.items():
            if variable.dtype.kind in "biuf":
                of = "1" if pure else unit(str(key), relative=relative, magnitude=magnitude)
                variable.attrs.setdefault("units", of)


def _chains(modes: Sequence[Mode]) -> dict[str, tuple[str, Any]]:
    """Coordinates of the chains of all solutions: the solution of each chain, and its weight."""
    each = [len(m.z) for m in modes]
    weight = np.array([m.weight for m in modes]) / sum(m.weight for m in modes)
    return {
        "solution": ("chain", np.repeat(np.arange(len(modes)), each)),
        "weight": ("chain", np.repeat(weight / each, each)),
    }


def _stacked(parts: Sequence[xr.Dataset], length: int) -> xr.Dataset:
    """The first draws of the chains of all solutions, concatenated along ``chain``."""
    short = [part.isel(draw=slice(length)) for part in parts]
    names = [k for k in short[0].data_vars if all(k in one for one in short)]
    whole = xr.concat(
        [one[names] for one in short],
        "chain",
        data_vars="all",
        coords="minimal",
        compat="override",
        join="override",
    )
    return whole.assign_coords(chain=np.arange(whole.sizes["chain"]))


def _stats(mode: Mode) -> xr.Dataset:
    stats = {STATS[k]: (("chain", "draw"), v) for k, v in mode.stats.items()}
    dims, energy = stats["lp"]
    stats["lp"] = (dims, -energy)
    if "step_size" in mode.tuning:
        each = np.broadcast_to(mode.tuning["step_size"][:, None], mode.z.shape[:2])
        stats["step_size"] = (dims, each)
    shape = zip(dims, mode.z.shape, strict=False)
    return xr.Dataset(stats, {k: np.arange(n) for k, n in shape})


def _mass(problem: Problem, mode: Mode) -> dict[str, xr.DataArray]:
    """The inverse mass matrix of each chain, with the names of the sampled coordinates."""
    if INVERSE_MASS not in mode.tuning:
        return {}
    names = [
        name if len(rows) == 1 else f"{name}[{i}]"
        for name in problem.names
        for rows in [problem.rows([name])]
        for i in range(len(rows))
    ]
    values = mode.tuning[INVERSE_MASS]
    chains = np.arange(len(values))
    axes = {"chain": chains, "coordinate": names, "other_coordinate": names}
    about = {
        "description": "inverse mass matrix of NUTS after the warm-up, in the unconstrained "
        "coordinates that were sampled",
        "units": "products of the units of the two coordinates",
    }
    return {INVERSE_MASS: xr.DataArray(values, axes, tuple(axes), attrs=about)}


def _sampling(posterior: Posterior, modes: Sequence[Mode]) -> dict[str, Any]:
    """Sampler settings as attributes: one value, or one for each chain where they differ."""
    asked, timing = posterior.settings, posterior.timing
    attrs: dict[str, Any] = {
        "inference_library": "lcbayes",
        "inference_library_version": installed_version(),
        "sampler": asked.sampler,
        "metric": METRIC[asked.sampler],
        "tuning_steps": asked.num_warmup or 0,
        "sampling_time": timing.sampling_s,
    }
    tuned = [m for m in modes if m.tuning]
    for name in [k for k in tuned[0].tuning if k != INVERSE_MASS] if tuned else ():
        attrs[name] = np.concatenate([m.tuning[name] for m in tuned])
    if "step_size" in attrs:
        steps = np.concatenate([m.stats["num_steps"].mean(axis=1) for m in tuned])
        attrs["trajectory_length"] = attrs["step_size"] * steps
    return attrs


def _recorded(
    problem: Problem, z: Floats, data: Epochs, key: jax.Array
) -> tuple[dict[str, NDArray[Any]], Floats, Floats]:
    """Every site without one value per epoch, (C, S, ...), and, (C, S, T), the pointwise log
    likelihood and one replicate of the data. They share the brightness, which is slow to compute.
    """
    keys = jax.random.split(key, z.shape[0] * z.shape[1])
    found = over_draws(partial(_predicted, problem), problem, z.reshape(-1, z.shape[2]), data, keys)
    return jax.tree.map(lambda x: x.reshape(*z.shape[:2], *x.shape[1:]), found)


@partial(jax.jit, static_argnums=0)
def _predicted(
    problem: Problem, rows: jax.Array, data: Epochs, lit: Lit | None, keys: jax.Array
) -> tuple[Sites, jax.Array, jax.Array]:
    def one(args: tuple[jax.Array, Lit | None, jax.Array]) -> tuple[Sites, jax.Array, jax.Array]:
        row, lit, key = args
        given = with_lit(data, lit)
        sites = problem.constrain(row, given)
        replicate = problem.replicate(row, given, key, sites)
        likelihood = problem.log_likelihood(row, given, sites[FLUX])
        return without_epochs(sites), likelihood, replicate

    return jax.lax.map(one, (rows, lit, keys))


def _curves(problem: Problem, mode: Mode, data: Epochs) -> xr.Dataset | None:
    """Brightness without noise of the best draw and of `CURVES` others; None if not recorded."""
    chains, draws = mode.z.shape[:2]
    energy = np.asarray(mode.stats["potential_energy"]).reshape(-1)
    best = int(np.nanargmin(energy)) if np.isfinite(energy).any() else 0
    spread = np.linspace(0, chains * draws - 1, min(CURVES, chains * draws)).round().astype(int)
    rows = np.array([best, *spread[spread != best]])
    drawn = mode.z.reshape(chains * draws, -1)[rows]
    sites = [compiled(problem.constrain)(z, data) for z in drawn]
    if EXPECTED not in sites[0]:
        return None
    brightness = np.stack([np.asarray(one[EXPECTED]) for one in sites])
    return xr.Dataset(
        {EXPECTED: (("curve_draw", "time"), brightness)},
        {
            "chain_of": ("curve_draw", rows // draws),
            "draw_of": ("curve_draw", rows % draws),
            "time": np.arange(brightness.shape[1]),
        },
    )


def _log_likelihood(
    points: xr.Dataset, rows: NDArray[np.int64], data: Epochs
) -> dict[str, xr.Dataset]:
    """The groups `log_likelihood` and, if there are dark epochs, `log_likelihood_dark`."""
    flat = points[OBSERVED].to_numpy().reshape(-1, points.sizes["time"])
    power = float(data.information)
    elpd, khat = loo(flat[rows], power)
    dark = without_tail(flat) | without_tail(flat[rows])
    attrs = {
        "information_per_point": power,
        "elpd_loo": float(elpd.sum()),
        "elpd_loo_se": float(np.sqrt(elpd.size * elpd.var() / power)),
        "elpd_loo_dark": float(elpd[dark].sum()),
        "max_pareto_k": float(khat.max()),
    }
    groups = {LOG_LIKELIHOOD: points.isel(time=~dark).assign_attrs(attrs)}
    if dark.any():
        groups[DARK] = points.isel(time=dark).rename(time=DARK_TIME)
    return groups


def _log_prior(problem: Problem, z: Floats, data: Epochs) -> dict[str, Any]:
    rows = jnp.asarray(z.reshape(-1, z.shape[-1]))
    each = _log_priors(problem, rows, data)
    return {k: (("chain", "draw"), np.asarray(v).reshape(z.shape[:2])) for k, v in each.items()}


@partial(jax.jit, static_argnums=0)
def _log_priors(problem: Problem, rows: jax.Array, data: Epochs) -> Sites:
    """ln of the prior density of each site and of the factors, (n,) each."""

    def one(row: jax.Array) -> Sites:
        return problem.log_prior(row, data) | {FACTORS: problem.log_factors(row, data)}

    return jax.lax.map(one, rows)


def _outliers(
    problem: Problem, z: Floats, data: Epochs, chosen: NDArray[np.int64]
) -> Floats | None:
    """Probability that each point is an outlier, (T,); None if the noise law has no outliers."""
    rows = jnp.asarray(z.reshape(-1, z.shape[-1])[chosen])
    if OUTLIER not in jax.eval_shape(problem.constrain, rows[0], data):
        return None
    each = jax.jit(lambda a: jax.lax.map(lambda row: problem.constrain(row, data)[OUTLIER], a))
    return np.asarray(each(rows)).mean(axis=0)


def _prior(problem: Problem, data: Epochs, seed: int, n: int = 500) -> xr.Dataset:
    sample = prior_sample(problem, data, jax.random.fold_in(jax.random.key(seed), 2), n)
    sites = constrain_draws(problem, sample.z[None], data)
    # the priors of zero points and of nutation need no draws: they are normal and independent
    draws = dataset(
        {k: v for k, v in sites.items() if not k.startswith(INTEGRATED_OUT) and k != AMOUNTS}
    )
    return draws.assign_attrs(
        {FACTORS: sample.note or "none", "with_factors": int(sample.honoured)}
    )


def _constants(
    curve: LightCurve, data: Epochs, entry: Entry, options: Mapping[str, Any]
) -> xr.Dataset:
    out = light_curve_variables(curve)
    if (hook := entry.hook("constants")) is not None:
        for name, values in hook(data, **options).items():
            axes = ("facet", "xyz") if name == "grid_normals" else None
            out[name] = (axes or tuple(f"{name}_{i}" for i in range(np.ndim(values))), values)
    return out


def save_tree(tree: xr.DataTree, path: Path) -> None:
    """Write netCDF. Large variables are compressed; those by draw and epoch are in single
    precision."""
    encoding: dict[str, dict[str, Any]] = {}
    for node in tree.subtree:
        for name, variable in node.data_vars.items():
            if variable.dtype.kind == "f" and variable.size > 10_000:
                epochs = {"time", DARK_TIME} & set(variable.dims)
                kind = "f4" if epochs and "draw" in variable.dims else "f8"
                encoding.setdefault(node.path, {})[str(name)] = {
                    "zlib": True,
                    "complevel": 1,
                    "shuffle": True,
                    "dtype": kind,
                }
    # built in memory, because HDF5 crashes the process if the disk fills while it writes
    with without_cluster():
        content = tree.to_netcdf(engine="h5netcdf", encoding=encoding)
    write_atomic(path, lambda p: p.write_bytes(content))
