"""Synthetic results folders, shaped as `lcbayes fit` writes them, for tests of what reads them."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import xarray as xr

CHAINS, DRAWS = 4, 250
RUN_TOML = (
    'schema = 4\ntask = "fit"\nversion = "0"\ncurve = "pass.csv"\n\n'
    '[options]\nmodel = "faceted"\nseed = 1\n'
)


def figures(folder: Path) -> set[str]:
    """Names of the figures in a results folder, each of which is there as SVG and as PDF."""
    kinds = {
        suffix: {p.stem for p in (folder / "figures").iterdir() if p.suffix == suffix}
        for suffix in (".svg", ".pdf")
    }
    assert kinds[".svg"] == kinds[".pdf"]
    assert len(list((folder / "figures").iterdir())) == 2 * len(kinds[".svg"])
    return kinds[".svg"]


def _unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def fibonacci(n: int) -> np.ndarray:
    """Nearly uniform unit vectors (n, 3)."""
    i = np.arange(n) + 0.5
    z, lon = 1 - 2 * i / n, np.pi * (1 + 5**0.5) * i
    return np.stack([np.sqrt(1 - z**2) * np.cos(lon), np.sqrt(1 - z**2) * np.sin(lon), z], 1)


def turn_z(angle: np.ndarray, v: np.ndarray) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    x, y, z = v[..., 0], v[..., 1], v[..., 2] + 0 * c
    return np.stack([c * x - s * y, s * x + c * y, z], -1)


def _flux(sun: np.ndarray, obs: np.ndarray, normals: np.ndarray, area: np.ndarray) -> np.ndarray:
    mu0 = np.maximum(sun @ np.swapaxes(normals, -1, -2), 0)
    mu = np.maximum(obs @ np.swapaxes(normals, -1, -2), 0)
    kernel = mu0 * mu * (0.1 + 1 / np.maximum(mu0 + mu, 1e-9)) / np.pi
    return np.einsum("...tn,...n->...t", kernel, area)


def _dataset(variables: dict[str, tuple[np.ndarray, tuple[str, ...]]]) -> xr.Dataset:
    return xr.Dataset(
        {name: (("chain", "draw", *dims), np.asarray(v)) for name, (v, dims) in variables.items()}
    )


def _stats(rng: np.random.Generator, divergences: int) -> xr.Dataset:
    shape = (CHAINS, DRAWS)
    diverging = np.zeros(shape, bool)
    diverging.flat[rng.choice(CHAINS * DRAWS, divergences, replace=False)] = True
    energy = 60 + 3 * rng.normal(size=shape)
    return _dataset(
        {
            "diverging": (diverging, ()),
            "energy": (energy, ()),
            "acceptance_rate": (rng.uniform(0.7, 1, shape), ()),
            "n_steps": (np.full(shape, 7), ()),
            "lp": (-energy, ()),
        }
    )


def _curves(mean: np.ndarray) -> xr.Dataset:
    """Brightness without noise of forty draws of a solution, from that of all (chain, draw, T)."""
    rows = np.linspace(0, CHAINS * DRAWS - 1, 40).round().astype(int)
    shown = mean.reshape(-1, mean.shape[-1])[rows]
    at = {"chain_of": rows // DRAWS, "draw_of": rows % DRAWS}
    coords = {name: ("curve_draw", value) for name, value in at.items()}
    return xr.Dataset(
        {"expected": (("curve_draw", "time"), shown)},
        coords | {"time": np.arange(mean.shape[-1])},
    )


def _rows(mode: xr.Dataset) -> dict[str, dict[str, float]]:
    """What a summary says of the areas."""
    rows = {}
    for i, draws in enumerate(np.moveaxis(mode["albedo_area"].to_numpy(), -1, 0)):
        quantiles = dict(
            zip(("q05", "q50", "q95"), np.quantile(draws, (0.05, 0.5, 0.95)), strict=True)
        )
        converged = {"rhat": 1.001, "ess_bulk": 900.0, "ess_tail": 800.0}
        row = {"mean": draws.mean(), "sd": draws.std()} | quantiles | converged
        rows[f"albedo_area[{i}]"] = {name: float(value) for name, value in row.items()}
    return rows


def _write(
    folder: Path,
    modes: list[xr.Dataset],
    weights: list[float],
    predict: Callable[[xr.Dataset], np.ndarray],
    observed: np.ndarray,
    sigma: np.ndarray,
    constant: dict[str, tuple[tuple[str, ...], np.ndarray]],
    attrs: dict[str, object],
    summary: dict[str, object],
    rng: np.random.Generator,
    divergences: int = 0,
) -> Path:
    """Stack the chains of the modes, add what follows from the draws, and write the folder."""
    each = [mode.sizes["chain"] for mode in modes]
    posterior = xr.concat(modes, "chain").assign_coords(
        chain=np.arange(sum(each)),
        solution=("chain", np.repeat(np.arange(len(modes)), each)),
        weight=("chain", np.repeat(np.divide(weights, each), each)),
    )
    coords: dict[str, xr.DataArray] = {k: posterior[k] for k in ("chain", "solution", "weight")}
    mean = predict(posterior)
    log_lik = -0.5 * ((observed - mean) / sigma) ** 2 - np.log(sigma * np.sqrt(2 * np.pi))
    replicate = mean + sigma * rng.normal(size=mean.shape)
    points = _dataset({"brightness": (log_lik, ("time",))}).assign_coords(
        coords | {"time": np.arange(observed.size)}
    )
    dark = np.ptp(log_lik, axis=(0, 1)) < 1e-12
    tree: dict[str, xr.Dataset] = {
        "/": xr.Dataset(attrs=attrs),
        "posterior": posterior,
        "posterior_predictive": _dataset({"brightness": (replicate, ("time",))}).assign_coords(
            coords
        ),
        "log_likelihood": points.isel(time=~dark),
        "prior": modes[0].isel(chain=[0]) * 1.5,
        "observed_data": xr.Dataset({"brightness": ("time", observed)}),
        "constant_data": xr.Dataset(dict(constant)),
    }
    if dark.any():
        tree["log_likelihood_dark"] = points.isel(time=dark).rename(time="dark_time")
    for k, mode in enumerate(modes):
        tree[f"modes/{k}/posterior"] = mode
        tree[f"modes/{k}/sample_stats"] = _stats(rng, divergences)
        tree[f"modes/{k}/curves"] = _curves(predict(mode))
    folder.mkdir(parents=True, exist_ok=True)
    xr.DataTree.from_dict(tree).to_netcdf(folder / "posterior.nc", engine="h5netcdf")
    (folder / "run.toml").write_text(RUN_TOML)
    chi2 = float(np.sum(((observed - mean.mean((0, 1))) / sigma) ** 2))
    rms = float(np.std(observed - mean.mean((0, 1))))
    full = {
        "model": attrs["model"],
        "n_facets": attrs["n_facets"],
        "n_obs": observed.size,
        "seed": attrs["seed"],
        "schema": 4,
        "task": "fit",
        "trusted": True,
        "reasons": [],
        "model_options": {},
        "max_rhat": 1.004,
        "min_ess_bulk": 812.0,
        "min_ess_tail": 640.0,
        "divergences": divergences,
        "parameters": {},
        "modes": [
            {"weight": w, "weight_sd": 0.03, "rms": rms, "parameters": _rows(mode)}
            for w, mode in zip(weights, modes, strict=True)
        ],
        "fit": {
            "rms": rms,
            "rms_unit": str(attrs["kind"]),
            "chi2": chi2,
            "dof": observed.size - 12,
            "elpd_loo": -118.3,
            "elpd_se": 7.9,
            "log_evidence": None,
            "log_evidence_se": None,
        },
        "timing": {"compile_s": 6.2, "warmup_s": 9.1, "sampling_s": 12.4, "gradients": 91234},
    } | summary
    (folder / "summary.json").write_text(json.dumps(full))
    return folder


def faceted(
    folder: Path,
    *,
    kind: str = "flux",
    bad: bool = False,
    title: str = "pass.csv",
    seed: int = 5,
    step: float = 5.0,
) -> Path:
    """Three facets, two passes, two solutions that are mirror images; ``bad``: not converged.

    Each pass lasts 300 s, with a point every ``step`` s.
    """
    rng = np.random.default_rng(seed)
    t = np.concatenate([np.arange(0, 300, step), 5400 + np.arange(0, 300, step)])
    sun = np.broadcast_to(_unit(np.array([1.0, 0.2, 0.3])), (t.size, 3))
    angle = np.linspace(-1.2, 1.2, t.size // 2)
    track = _unit(np.stack([np.cos(angle), np.sin(angle), 0.4 + 0 * angle], 1))
    obs = np.concatenate([track, turn_z(np.array(0.7), track)])
    phi, g = np.array([0.1, 2.3, 4.4]), np.array([0.3, -0.1, 0.55])
    area, omega = np.array([3.0, 5.0, 2.0]), np.array([0.002, -0.003, 0.031])
    range_km = 900 + 400 * np.abs(np.concatenate([angle, angle]))
    jitter = 0.6 if bad else 0.05

    def mode(mirror: float) -> xr.Dataset:
        noise = rng.normal(size=(CHAINS, DRAWS, 3, 3))
        if bad:  # each chain somewhere else
            noise += 3 * rng.normal(size=(CHAINS, 1, 3, 3))
        p = np.mod(phi + jitter * noise[..., 0], 2 * np.pi)
        gg = np.clip(mirror * g + 0.6 * jitter * noise[..., 1], -0.999, 0.999)
        s = np.sqrt(1 - gg**2)
        normals = np.stack([s * np.cos(p), s * np.sin(p), gg], -1)
        spin = omega * [mirror, mirror, 1] + 0.0004 * rng.normal(size=(CHAINS, DRAWS, 3))
        return _dataset(
            {
                "albedo_area": (area * np.exp(jitter * noise[..., 2]), ("facet",)),
                "normals": (normals, ("facet", "xyz")),
                "phi": (p, ("facet",)),
                "g": (gg, ("facet",)),
                "omega": (spin, ("xyz",)),
                "omega_unit": (spin / 0.02, ("xyz",)),  # what is sampled: not for the reader
                "glitter": (rng.normal(0.3, 0.01, (CHAINS, DRAWS)), ()),  # nobody knows it
            }
        )

    def predict(posterior: xr.Dataset) -> np.ndarray:
        spin = t * omega[2]  # only about z, and the same in all draws: it is a picture
        s, o = turn_z(-spin, sun), turn_z(-spin, obs)
        normals = posterior["normals"].to_numpy().copy()
        normals[..., 0, 2] = np.abs(normals[..., 0, 2])  # so that both solutions fit
        normals[..., 1, 2] = -np.abs(normals[..., 1, 2])
        normals[..., 2, 2] = np.abs(normals[..., 2, 2])
        flux = _flux(s, o, normals, posterior["albedo_area"].to_numpy())
        if kind == "flux":
            return flux
        return -26.7 - 2.5 * np.log10(flux + 1e-4) + 5 * np.log10(1e3 * range_km)

    modes = [mode(1.0), mode(-1.0)]
    truth = predict(modes[0].median(("chain", "draw"))) if bad else predict(modes[0])[0, 0]
    sigma = np.full(t.size, 0.08 if kind == "mag" else 0.03)
    observed = truth + sigma * rng.normal(size=t.size)
    reasons = [
        "R-hat of albedo_area[0] is 2.31, above 1.01: the chains sit in different places.",
        "37 transitions diverged: the sampler could not follow the posterior there.",
    ]
    constant: dict[str, tuple[tuple[str, ...], np.ndarray]] = {
        "t": (("time",), t),
        "sun": (("time", "xyz"), sun),
        "obs": (("time", "xyz"), obs),
        "error": (("time",), sigma),
        "curve": (("time",), (t > 1000).astype(int)),
        "range_km": (("time",), range_km),
    }
    attrs = {
        "model": "faceted",
        "kind": kind,
        "frame": "icrs",
        "epoch_jd": 2460000.5,
        "n_facets": 3,
        "seed": 1,
        "command": "lcbayes fit pass.csv -o out --seed 1",
        "version": "0.1.0",
        "source_file": title,
        "created": "2025-01-01T00:00:00Z",
        "assumptions": json.dumps(
            [
                "The object is rigid and turns at a constant angular velocity.",
                "Each facet scatters diffusely; facets do not shade one another.",
                "Noise is Gaussian with the errors given in the file.",
            ]
        ),
    }
    against = [{"code": "chains-disagree", "text": text} for text in reasons]
    summary = {"trusted": False, "reasons": against, "max_rhat": 2.31} if bad else {}
    return _write(
        folder,
        modes,
        [0.62, 0.38],
        predict,
        observed,
        sigma,
        constant,
        attrs,
        summary,
        rng,
        divergences=37 if bad else 0,
    )


def asteroid(
    folder: Path, *, n_facets: int = 120, n_curves: int = 16, dark: bool = False, seed: int = 7
) -> Path:
    """A convex body on a grid of normals, relative curves over decades, two mirror poles."""
    rng = np.random.default_rng(seed)
    grid = fibonacci(n_facets)
    axes = np.array([1.5, 1.1, 0.9])
    true_area = np.prod(axes) ** 2 / np.linalg.norm(grid * axes, axis=1) ** 4
    true_area *= 4 * np.pi / true_area.sum()
    period = 5.76198
    pole = {1.0: (253.2, -17.2), -1.0: (70.3, -16.1)}
    starts = np.sort(rng.uniform(0, 25 * 365.25, n_curves))
    curve = np.repeat(np.arange(n_curves), rng.integers(12, 50, n_curves))
    t = np.concatenate(
        [
            starts[c] * 86400 + np.linspace(0, 5.5 * 3600, n)
            for c, n in zip(*np.unique(curve, return_counts=True), strict=True)
        ]
    )
    lon = 2 * np.pi * t / (3.27 * 365.25 * 86400)
    sun = np.stack([np.cos(lon), np.sin(lon), 0.05 * np.sin(3 * lon)], 1)
    sun = _unit(sun)
    obs = turn_z(0.3 * np.sin(2 * lon), sun)

    def mode(mirror: float) -> xr.Dataset:
        shape = (CHAINS, DRAWS)
        relief = np.exp(0.08 * rng.normal(size=(*shape, n_facets)))
        lon0, lat0 = pole[mirror]
        return _dataset(
            {
                "albedo_area": (true_area * relief, ("facet",)),
                "pole_lon_deg": (lon0 + 0.8 * rng.normal(size=shape), ()),
                "pole_lat_deg": (lat0 + 1.3 * rng.normal(size=shape), ()),
                "period_h": (period + 4e-6 * rng.normal(size=shape), ()),
                "coefficients": (rng.normal(size=(*shape, 49)), ("coefficient",)),
                "scale": (1 + 0.004 * rng.normal(size=(*shape, n_curves)), ("curve",)),
                "phase_a": (0.5 + 0.05 * rng.normal(size=shape), ()),
                "phase_d": (0.1 + 0.02 * np.abs(rng.normal(size=shape)), ()),
                "phase_k": (-0.5 + 0.03 * rng.normal(size=shape), ()),
                "sigma": (0.014 + 3e-4 * rng.normal(size=shape), ()),
                "log_sigma": (np.log(0.014) + 0.02 * rng.normal(size=shape), ()),
                "expected": (np.ones((*shape, t.size)), ("time",)),
            }
        )

    def predict(posterior: xr.Dataset) -> np.ndarray:
        spin = 2 * np.pi * np.mod(t / 3600 / posterior["period_h"].median().item(), 1)
        s, o = turn_z(-spin, sun), turn_z(-spin, obs)
        flux = _flux(s, o, grid, posterior["albedo_area"].to_numpy())
        return flux / flux.mean(-1, keepdims=True) * posterior["scale"].to_numpy()[..., curve]

    modes = [mode(1.0), mode(-1.0)]
    sigma = np.full(t.size, 0.014)
    observed = predict(modes[0].isel(draw=[0]))[0, 0] + sigma * rng.normal(size=t.size)
    constant: dict[str, tuple[tuple[str, ...], np.ndarray]] = {
        "t": (("time",), t),
        "sun": (("time", "xyz"), sun),
        "obs": (("time", "xyz"), obs),
        "error": (("time",), np.full(t.size, np.nan)),
        "curve": (("time",), curve),
        "grid_normals": (("facet", "xyz"), grid),
    }
    attrs = {
        "model": "convex-grid",
        "kind": "flux",
        "frame": "ecliptic-j2000",
        "epoch_jd": 2438882.2,
        "n_facets": n_facets,
        "seed": 3,
        "version": "0.1.0",
        "source_file": "43_Ariadne_rel.lcs",
        "command": "lcbayes fit 43_Ariadne_rel.lcs --model convex-grid --period 5.762 -o out",
        "assumptions": json.dumps(["The body is convex.", "It turns about its shortest axis."]),
        "created": "2025-01-01T00:00:00Z",
    }
    solutions = [
        {"weight": 0.5, "pole_lon_deg": pole[m][0], "pole_lat_deg": pole[m][1], "period_h": period}
        for m in (1.0, -1.0)
    ]

    def predict_dark(posterior: xr.Dataset) -> np.ndarray:
        mean = predict(posterior)
        mean[..., :7] = 0.0  # the same in every draw: a constant log-likelihood
        return mean

    if dark:
        observed[:7] = sigma[:7] * rng.normal(size=7)
    return _write(
        folder,
        modes,
        [0.5, 0.5],
        predict_dark if dark else predict,
        observed,
        sigma,
        constant,
        attrs,
        {"modes": solutions},
        rng,
    )
