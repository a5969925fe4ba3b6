"""Starlink v1.5 observed by Pomenis: a fit to a random half of the points predicts the other half.

python benchmarks/pomenis.py [--facets 2] [--halves 10] [--num-samples 3000] [--compare FOLDER]
                             [--keep FILE]
"""

from __future__ import annotations

import argparse
import json
import os
import time
from pathlib import Path

import numpy as np
from _results import table, write_section

import lcbayes
from lcbayes.data.read import read
from lcbayes.tasks.predict.brightness import predicted

FILE = Path("starlink-v1.5-pomenis") / "pomenis_observations.csv"
GOAL, PUBLISHED = 0.64, (0.715, 0.775)


def data() -> Path:
    return Path(os.environ.get("LCBAYES_DATA", Path(__file__).parents[2] / "shared" / "data"))


def half(curve: lcbayes.LightCurve, options: dict, settings: dict, seed: int) -> dict:
    """Residuals and coverage of the half that was not fitted, for one division."""
    first = np.random.default_rng(seed).permutation(curve.n_obs) < curve.n_obs // 2
    fitted, other = curve.select(first), curve.select(~first)
    begun = time.perf_counter()
    result = lcbayes.fit(fitted, model="stabilised", seed=seed, **options, **settings)
    took = time.perf_counter() - begun
    columns, _ = predicted(result.posterior, fitted, other, "stabilised", options, seed)
    residual = other.brightness - columns["mag_mean"]
    inside = {
        level: float(np.mean((other.brightness >= columns[a]) & (other.brightness <= columns[b])))
        for level, a, b in (("90", "mag_q05", "mag_q95"), ("50", "mag_q25", "mag_q75"))
    }
    summary = result.content
    return {
        "seed": seed,
        "sd": float(residual.std()),
        "bias": float(residual.mean()),
        "middle": float(np.diff(np.quantile(residual, (0.16, 0.84)))[0] / 2),
        "inside": inside,
        "seconds": took,
        "converged": result.trusted,
        "reasons": [reason.text for reason in result.reasons],
        "fit_rms": summary["fit"]["rms"],
        "max_rhat": summary["max_rhat"],
        "timing": summary["timing"],
        "modes": len(summary["modes"]),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--facets", type=int, default=2)
    parser.add_argument("--halves", type=int, default=10)
    parser.add_argument("--num-samples", type=int, default=3000, help="draws of each chain")
    parser.add_argument("--compare", type=Path, help="results of lcbayes compare, to quote")
    parser.add_argument("--keep", type=Path, help="file of divisions done, to go on from")
    args = parser.parse_args()
    curve = read(data() / FILE)
    options = {"n_facets": args.facets}
    settings = {"num_samples": args.num_samples}
    done = json.loads(args.keep.read_text()) if args.keep and args.keep.exists() else []
    for seed in range(len(done), args.halves):
        done.append(half(curve, options, settings, seed))
        print(json.dumps(done[-1]), flush=True)
        if args.keep:
            args.keep.write_text(json.dumps(done))
    done = done[: args.halves]
    column = lambda key: np.array([one[key] for one in done])  # noqa: E731
    cover = np.array([one["inside"]["90"] for one in done])
    heads = [
        "half",
        "residual sd of the other half (mag)",
        "16-84 % half-width",
        "in 90 %",
        "in 50 %",
        "max R-hat",
        "s",
    ]
    rows = [
        [
            str(d["seed"]),
            f"{d['sd']:.3f}",
            f"{d['middle']:.3f}",
            f"{d['inside']['90']:.1%}",
            f"{d['inside']['50']:.1%}",
            f"{d['max_rhat']:.3f}",
            f"{d['seconds']:.0f}",
        ]
        for d in done
    ]
    text = (
        f"{curve.n_obs} AB magnitudes of satellites of one make over {np.ptp(curve.t) / 86400:.0f} "
        f"days; model `stabilised` as it stands but for `n_facets={args.facets}`: normals, areas "
        "and surfaces unknown, nadir and the Sun's azimuth for axes, Student-t scatter; four "
        f"chains of {args.num_samples} draws.\n\n"
        f"{table(heads, rows)}\n\n"
        f"Median residual sd {np.median(column('sd')):.3f} mag (goal: at most {GOAL}; published "
        f"for these points {PUBLISHED[0]} with all of them fitted, {PUBLISHED[1]} from laboratory "
        f"BRDFs; sd of the magnitudes {curve.brightness.std():.3f}). The 90 % interval holds "
        f"{cover.mean():.1%} on average, {cover.min():.1%} to {cover.max():.1%} (goal: 87 to "
        f"93 %). {int(column('converged').sum())} of {len(done)} fits converged; median "
        f"{np.median(column('seconds')):.0f} s, with other work on the machine."
    )
    if args.compare:
        said = json.loads((args.compare / "compare.json").read_text())
        heads = ["facets", "ln evidence", "±", "probability", "elpd"]
        rows = [
            [
                str(c["n_facets"]),
                f"{c['log_evidence']:.1f}",
                f"{c['log_evidence_se']:.1f}",
                f"{c['probability']:.3g}",
                f"{c['elpd_loo']:.1f}",
            ]
            for c in said["candidates"]
        ]
        text += f"\n\nHow many facets, by `lcbayes compare`:\n\n{table(heads, rows)}"
        text += f"\n\n{said['conclusion']}"
    extra = f" --facets {args.facets} --halves {args.halves}" + (
        " --compare FOLDER" if args.compare else ""
    )
    write_section(
        f"Pomenis: {args.facets} facets of a stabilised satellite",
        "python benchmarks/pomenis.py" + extra,
        text,
    )


if __name__ == "__main__":
    main()
