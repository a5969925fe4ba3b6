"""Figure 7 of Linares & Crassidis: measurements predicted by the posterior of six facets.

The bands contain 50 and 90 % of the predicted measurements, noise included; below, the same minus
the mean, in units of σ. Printed: the fraction of the measurements inside each band.
"""

from __future__ import annotations

import _script
import numpy as np
import six_facets
from figure4 import band

from lcbayes.analysis import style
from lcbayes.core.jax_setup import jax, jnp


def main() -> None:
    args = six_facets.parser(__doc__ or "").parse_args()
    made = six_facets.experiment(args.seed)
    data = made.data
    problem, runs = six_facets.sample_six(data, args)
    z = jnp.asarray(six_facets.pooled(runs, args.draws))
    keys = jax.random.split(jax.random.key(args.seed), len(z))
    drawn = np.asarray(jax.jit(jax.vmap(lambda z, k: problem.replicate(z, data, k)))(z, keys))
    curve = made.curve
    assert curve.error is not None
    t, sigma, off = curve.t, float(np.median(curve.error)), drawn.mean(axis=0)
    for share in (0.5, 0.9):
        low, high = np.quantile(drawn, [0.5 - share / 2, 0.5 + share / 2], axis=0)
        inside = np.mean((curve.brightness >= low) & (curve.brightness <= high))
        print(f"{inside:.0%} of {t.size} measurements in the {share:.0%} band")
    figure = _script.figure(9.0, 4.6)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(2.2, 1.0))
    blue = style.PALETTE[0]
    length = (t[-1] + six_facets.PAUSE - t[0]) / 3
    for i, plane in enumerate(("x-y", "y-z", "z-x")):
        here = (t >= i * length - 1e-6) & (t < (i + 1) * length - 1e-6)
        first = i == 0
        band(
            upper,
            t[here],
            drawn[:, here],
            np.zeros(here.sum()),
            1.0,
            blue,
            "predicted, 50 and 90 %" if first else "",
        )
        band(lower, t[here], drawn[:, here], off[here], sigma, blue, "")
        upper.plot(
            t[here], made.clean[here], color=style.INK, lw=0.9, label="truth" if first else None
        )
        upper.text(t[here][0], 1.02, f"pass in {plane}", transform=upper.get_xaxis_transform())
    upper.plot(t, curve.brightness, ".", ms=4, color=style.DATA, label="measured")
    lower.plot(t, (curve.brightness - off) / sigma, ".", ms=4, color=style.DATA)
    lower.axhline(0.0, color=style.FAINT, lw=0.6)
    upper.legend(loc="upper right", ncols=3)
    upper.set_ylim(top=1.25 * curve.brightness.max())
    upper.set_ylabel("flux at unit distance (m²)")
    lower.set_ylabel("residual / σ")
    lower.set_xlabel("time (s)")
    _script.save(figure, args.out, "figure7")


if __name__ == "__main__":
    main()
