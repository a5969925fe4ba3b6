"""Figure 6 of Linares & Crassidis: the posterior of six facets under the log-normal prior.

The posterior is sampled by tempered particles from the prior, with the number of facets at which
the sparse path of figure 5 ends. Rows: albedo-area, azimuth and g of each facet, named after the
side of the cube closest to its normal. The paper shows one chain, which starts at the end of its
burn-in. For ±z the azimuth is undefined, so the two small components of the normal are shown.
"""

from __future__ import annotations

import _script
import numpy as np
import six_facets
from scipy.optimize import linear_sum_assignment
from six_facets import AREA, SIDES, Floats

from lcbayes.analysis import style

AXES = np.vstack([np.eye(3), -np.eye(3)])
ACROSS = ((1, 2), (2, 0), (0, 1))  # the components of a normal that vanish, for x, y, z


def by_side(areas: Floats, normals: Floats) -> tuple[Floats, Floats]:
    """Facets (S, N), (S, N, 3) in the order of `SIDES`, matched by minimum distance."""
    areas, normals = areas.copy(), normals.copy()
    for i, n in enumerate(normals):
        order = linear_sum_assignment(-AXES @ n.T)[1]
        areas[i], normals[i] = areas[i][order], n[order]
    return areas, normals


def main() -> None:
    args = six_facets.parser(__doc__ or "").parse_args()
    made = six_facets.experiment(args.seed)
    data = made.data
    problem, runs = six_facets.sample_six(data, args)
    z = six_facets.pooled(runs, args.draws)
    areas, normals = by_side(*six_facets.facets(problem, data, z))
    chi2 = six_facets.misfit(problem, data, z)
    evidences = ", ".join(f"{r.log_evidence:.2f}" for r in runs)
    print(f"ln Z of the runs: {evidences}; chi2 {np.median(chi2):.0f} at {data.t.size} epochs")
    figure = _script.figure(10.0, 4.6)
    rows = figure.subplots(2, len(SIDES), sharex="row")
    for i, side in enumerate(SIDES):
        upper, lower = rows[:, i]
        hue = style.colour(i)
        upper.hist(areas[:, i], bins=50, density=True, color=hue, alpha=0.45)
        upper.axvline(AREA, color=style.INK, lw=0.8, ls=":")
        upper.set_title(f"facet {side}", loc="left")
        upper.set_xlabel(r"albedo-area $\alpha$ (m²)")
        across = np.degrees(np.arcsin(normals[:, i][:, list(ACROSS[i % 3])]))
        names = ["xyz"[k] for k in ACROSS[i % 3]]
        lower.plot(*across.T, ".", ms=2, alpha=0.3, mew=0, color=hue, rasterized=True)
        lower.plot(0.0, 0.0, "+", color=style.INK, ms=9, mew=1.2)
        lower.set_xlabel(f"tilt towards {names[0]} (°)")
        lower.set_ylabel(f"towards {names[1]} (°)")
        upper.set_yticks([])
        upper.spines["left"].set_visible(False)
        low, high = np.quantile(areas[:, i], [0.05, 0.95])
        held = "holds" if low <= AREA <= high else "misses"
        mean, tilt = np.mean(areas[:, i]), across.std(axis=0)
        print(
            f"{side}: area {mean:.2f} m², 90 % {low:.2f} to {high:.2f} ({held} {AREA:g}); "
            f"sd of the tilts {tilt[0]:.2f}°, {tilt[1]:.2f}°"
        )
    reach = 1.05 * max(np.abs(axes.get_ylim()).max() for axes in rows[1])
    for axes in rows[1]:
        axes.set_xlim(-reach, reach)
        axes.set_ylim(-reach, reach)
        axes.set_aspect("equal")
    _script.save(figure, args.out, "figure6")


if __name__ == "__main__":
    main()
