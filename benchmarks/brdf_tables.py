"""Laboratory BRDFs of a satellite's surfaces compared with the reflectance laws of this package.

    python benchmarks/brdf_tables.py         $LCBAYES_DATA or ../shared/data; table and figure

The tables give f_r in the plane of incidence at 532 nm, for four angles of incidence. Each law is
fitted to ln f_r with equal weight for every direction, because a light curve is in magnitudes. As a
test of laws with more parameters, each is also fitted to three angles of incidence to predict the
fourth.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from _results import table, write_section
from scipy.optimize import least_squares
from scipy.stats import qmc

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.physics.reflectance import LAWS, geometry

ROOT = Path(__file__).parents[1]
DATA = Path(os.environ.get("LCBAYES_DATA", ROOT.parent / "shared" / "data"))
TABLES = {"chassis": "chassis_brdf.csv", "solar array": "solar_array_brdf.csv"}
NOTHING = 1e-4  # placeholder in the tables for directions without a measurement
STARTS = 16
MAG = 2.5 / np.log(10.0)
# Range of the search for each parameter; all but a slope are searched in the logarithm.
RANGE = {
    "r_diff": (1e-4, 1.0),
    "r_spec": (1e-4, 1.0),
    "nu": (1.0, 1e6),
    "n": (1.0, 1e6),
    "m": (1e-3, 1.0),
    "w": (1e-4, 1.0),
    "a": (1e-3, 1.0),
    "d": (1e-3, 1.0),
    "c": (1e-3, 1.0),
    "k": (-0.317, 0.0),
}


def read(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Angles of incidence and of view (deg, positive on the specular side) and f_r."""
    incidence, azimuth, view, other, value = np.loadtxt(path).T
    assert np.all(azimuth == -180.0)
    assert np.all(other == 0.0)
    kept = (value > NOTHING) & (np.abs(view) < 90.0)
    return incidence[kept], view[kept], value[kept]


def law_of(name: str, incidence: np.ndarray, view: np.ndarray):
    """ln f_r of a law in the given directions, as a function of the search variables; its
    derivative; the parameters' names and bounds."""
    i, o = np.radians(incidence), np.radians(view)
    sun = jnp.asarray(np.stack([-np.sin(i), 0 * i, np.cos(i)], 1))
    obs = jnp.asarray(np.stack([np.sin(o), 0 * o, np.cos(o)], 1))
    seen, lit = geometry(sun, obs, jnp.array([[0.0, 0.0, 1.0]]))
    assert bool(lit.all())
    names = [k for k in LAWS[name].parameters if k != "nv"]
    low, high = np.array([RANGE[k] for k in names]).T
    straight = np.array([k == "k" for k in names])

    def parameters(x) -> dict[str, jax.Array]:
        return {k: x[j] if straight[j] else jnp.exp(x[j]) for j, k in enumerate(names)}

    def log_brdf(x):
        result = LAWS[name].brdf(seen, parameters(x))[:, 0]
        return jnp.log(jnp.maximum(result, 1e-300))

    with np.errstate(invalid="ignore", divide="ignore"):
        bounds = tuple(np.where(straight, v, np.log(np.abs(v))) for v in (low, high))
    return jax.jit(log_brdf), jax.jit(jax.jacfwd(log_brdf)), parameters, bounds


def fitted(law: tuple, target: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """The best fit of many starts to the given rows of the table, in the variables of `law_of`."""
    log_brdf, slope, _, (low, high) = law
    best = None
    for u in qmc.Sobol(len(low), rng=1).random(STARTS):
        result = least_squares(
            lambda x: (np.asarray(log_brdf(x)) - target)[rows],
            low + (0.02 + 0.96 * u) * (high - low),
            lambda x: np.asarray(slope(x))[rows],  # pyright: ignore[reportArgumentType]
            bounds=(low, high),
        )
        if best is None or result.cost < best.cost:
            best = result
    assert best is not None
    return best.x


def compared(table_of: tuple) -> dict[str, dict]:
    """Each law with its residuals, its prediction of left-out angles, and its parameters."""
    incidence, view, value = table_of
    every = np.ones(incidence.size, bool)
    target = np.log(value)
    out = {}
    for name in LAWS:
        law = law_of(name, incidence, view)

        def residual(x: np.ndarray, law: tuple = law) -> np.ndarray:
            return MAG * (target - np.asarray(law[0](x)))

        x = fitted(law, target, every)
        left = [
            residual(fitted(law, target, incidence != a))[incidence == a]
            for a in np.unique(incidence)
        ]
        off = residual(x)
        out[name] = {
            "x": x,
            "rms": float(np.sqrt(np.mean(off**2))),
            "median": float(np.median(np.abs(off))),
            "left_out": float(np.sqrt(np.mean(np.concatenate(left) ** 2))),
            "parameters": {k: float(v) for k, v in law[2](x).items()},
        }
        print(name, {k: v for k, v in out[name].items() if k != "x"}, flush=True)
    return out


def figure(result: Mapping[str, tuple[tuple, dict]], path: Path) -> None:
    """The tables and the two best laws, one panel per angle of incidence."""
    import matplotlib

    from lcbayes.analysis import style

    with matplotlib.rc_context(style.RC):  # pyright: ignore[reportArgumentType]
        from matplotlib.figure import Figure

        canvas = Figure(figsize=(11.0, 5.4), layout="constrained")
        panels = canvas.subplots(len(result), 4, sharex=True, sharey="row")
        for line, (what, (table_of, laws)) in zip(panels, result.items(), strict=True):
            incidence, view, value = table_of
            best = sorted(laws, key=lambda k: laws[k]["left_out"])[:2]
            for axes, one in zip(line, np.unique(incidence), strict=True):
                here = incidence == one
                axes.semilogy(
                    view[here], value[here], ".", ms=2.5, color=style.INK, label="measured"
                )
                grid = np.linspace(-89.0, 89.0, 713)
                for j, name in enumerate((*best, "lambertian")):
                    drawn = law_of(name, np.full(grid.size, one), grid)[0](laws[name]["x"])
                    axes.semilogy(
                        grid,
                        np.exp(np.asarray(drawn)),
                        lw=1.3,
                        color=style.colour(j),
                        label=name,
                        ls="--" if name == "lambertian" else "-",
                    )
                axes.set_title(f"{what}, light from {one:g}°")
                axes.set_xticks([-90, -45, 0, 45, 90])
            line[0].set_ylabel("BRDF (1/sr)")
            line[0].set_ylim(5e-4, 3.0 * value.max())
            line[0].legend(loc="upper left", fontsize=7)
        for axes in panels[-1]:
            axes.set_xlabel("angle of view (deg)")
        canvas.savefig(path, dpi=130)


def main() -> None:
    result, text = {}, ""
    for what, name in TABLES.items():
        table_of = read(DATA / "starlink-v1.5-pomenis" / name)
        laws = compared(table_of)
        result[what] = table_of, laws
        rows = [
            [
                law,
                str(len(laws[law]["parameters"])),
                f"{laws[law]['rms']:.2f}",
                f"{laws[law]['median']:.2f}",
                f"{laws[law]['left_out']:.2f}",
                ", ".join(f"{k} {v:.3g}" for k, v in laws[law]["parameters"].items()),
            ]
            for law in sorted(laws, key=lambda k: laws[k]["left_out"])
        ]
        text += f"{what.capitalize()}, {table_of[0].size} directions:\n\n"
        text += (
            table(
                [
                    "law",
                    "parameters",
                    "rms (mag)",
                    "median abs. (mag)",
                    "rms of an angle of incidence left out (mag)",
                    "fitted",
                ],
                rows,
            )
            + "\n\n"
        )
    figure(result, ROOT / "docs" / "figures" / "brdf-tables.png")
    write_section(
        "Laboratory BRDFs against the reflectance laws", "python benchmarks/brdf_tables.py", text
    )


if __name__ == "__main__":
    main()
