"""Figure 5 of Linares & Crassidis: burn-in with ten facets for a body of six.

Printed first: which facets of eq. (32) are lit and seen in the paper's one pass, and in the three
passes of `six_facets`. Left: the ten albedo-areas of the chain that ends with the best fit, against
the transition, under the squared-L1 prior; right: the directions of its facets at the end, as rings
whose area is proportional to the facet's, with the sides of the cube as crosses. Below: χ² of all
chains, which the paper does not show.
"""

from __future__ import annotations

import _script
import burn_in
import numpy as np
import six_facets
from figure6 import AXES, SIDES
from six_facets import AREA, UPPER_BOUND

from lcbayes.analysis import style

CHAINS = 4


def lit() -> None:
    """Print which facets cannot be lit in the paper's geometry."""
    for n, what in ((1, "the paper's pass, in x-y"), (3, "three passes, in x-y, y-z and z-x")):
        made = six_facets.experiment(0, n)
        seen = [f"{s} {b:.2f}" for s, b in zip(_names(made.normals), made.best_seen(), strict=True)]
        print(f"largest min(μ₀, μ) in {what}: {', '.join(seen)}")


def _names(normals: np.ndarray) -> list[str]:
    return [SIDES[int(np.argmax(AXES @ n))] for n in normals]


def _across(lon: float) -> float:
    """Longitude on the map, in [−π, π); its edge is at 225°, away from all sides of the cube."""
    return (lon - 0.25 * np.pi + np.pi) % (2 * np.pi) - np.pi


def main() -> None:
    parser = _script.parser(__doc__ or "")
    parser.add_argument("--facets", type=int, default=UPPER_BOUND, help="to begin with")
    parser.add_argument("--chains", type=int, default=CHAINS)
    parser.add_argument("--transitions", type=int, default=burn_in.TRANSITIONS)
    args = parser.parse_args()
    lit()
    data = six_facets.experiment(args.seed).data
    problem, _ = six_facets.sparse_problem(data, args.facets, AREA * len(SIDES))
    result = burn_in.run(problem, data, args.chains, args.transitions, args.seed)
    for c in np.argsort(result.ends.mean(axis=1)):
        left = result.remaining(int(c))
        shares = ", ".join(f"{n}: {share:.2f}" for n, share in left.items())
        print(
            f"chain {c}: chi2 {result.ends[c].mean():.0f} at {data.t.size} epochs; facets that "
            f"remain {max(left, key=lambda n: left[n])} ({shares})"
        )

    import jax

    row = result.z[result.best]
    sites = jax.jit(jax.vmap(lambda z: problem.constrain(z, data)))(row)
    areas, normals = np.asarray(sites["albedo_area"]), np.asarray(sites["normals"])
    figure = _script.figure(9.6, 5.6)
    left, right = figure.subfigures(1, 2, width_ratios=(1.15, 1.0))
    above, below = left.subplots(2, 1, sharex=True)
    order = np.argsort(-areas[-1])
    # the six largest at the end in colour, on top of the others
    hues = [style.colour(i) if i < len(SIDES) else style.FAINT for i in range(args.facets)]
    for hue, k in reversed(list(zip(hues, order, strict=True))):
        above.plot(areas[:, k], lw=0.6 if hue == style.FAINT else 1.1, color=hue)
    above.axhline(AREA, color=style.INK, lw=0.8, ls=":")
    above.set_yscale("log")
    above.set_ylim(1e-3, 60.0)
    above.set_ylabel(r"albedo-area $\alpha$ (m²)")
    above.set_title(f"chain {result.best}: the areas of {args.facets} facets", loc="left")
    for c in range(args.chains):
        best = c == result.best
        below.plot(
            result.chi2[c], lw=1.2 if best else 0.7, color=style.PALETTE[0] if best else style.FAINT
        )
    below.axhline(data.t.size, color=style.INK, lw=0.8, ls=":")
    below.set_yscale("log")
    below.set_ylabel(r"$\chi^2$, all chains")
    below.set_xlabel("transition")
    sky = right.add_subplot(projection="mollweide")
    sky.grid(color="#d5d8dd", lw=0.5)
    sky.set_xticklabels([])
    sky.set_yticklabels([])
    sky.set_title("normals at the end; crosses: the cube", loc="left", pad=12)
    for hue, k in zip(hues, order, strict=True):
        x, y, z = normals[-1, k]
        at, size = (_across(np.arctan2(y, x)), np.arcsin(z)), 25 * max(areas[-1, k], 0.2)
        sky.scatter(*at, s=size, fc="none", ec=hue, lw=1.5, clip_on=False)
    for n, name in zip(AXES, SIDES, strict=True):
        at = (_across(np.arctan2(n[1], n[0])), np.arcsin(n[2]))
        sky.plot(*at, "+", color=style.INK, ms=8, mew=1.2, clip_on=False)
        sky.annotate(name, at, (5, 5), textcoords="offset points", fontsize=8)
    _script.save(figure, args.out, "figure5")


if __name__ == "__main__":
    main()
