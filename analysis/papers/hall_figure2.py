"""Figure 2 of Hall et al. 2007: signatures of a single facet in a low orbit, from two sites.

A facet of 1 m² with a Lambertian albedo of 30 %, fixed in LVLH axes, passes over Maui and Kauai.
Left: sunlight reaches it during the pass, and both sites see it brighten at once. Right: it comes
into view of one site after the other. Magnitudes are at 1,000 km. The paper gives neither orbit nor
normals; those used here are the first of a grid that show each case alone and well within the pass.
Printed: the times of the edges, and the results of `lcbayes single-facet` for both noisy curves.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import _script
import numpy as np

from lcbayes.analysis import single_facet_report, style
from lcbayes.core.jax_setup import jnp
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.separated.single_facet import single_facet
from lcbayes.modelling.ephemeris import ephemeris, frames
from lcbayes.physics import photometry
from lcbayes.physics.bodies import facets
from lcbayes.simulation.scenarios import scenario
from lcbayes.simulation.scenarios.epochs import epochs
from lcbayes.simulation.simulate import flux_at, simulate

SCENARIO = Path(__file__).with_name("hall-facet.toml")
RANGE_M = 1e6
CASES = ("illumination", "visibility")


def normal_of(case: str, curve: LightCurve, law: scenario.Attitude) -> np.ndarray:
    """A normal whose facet appears by this change alone, for every site, well within the pass."""
    turn = np.asarray(frames(law, curve).body)
    sun, obs = (np.einsum("tij,ti->tj", turn, v) for v in (curve.sun, curve.obs))
    best, best_normal = 0.0, None
    for normal in facets.grid(4000):
        mu0, mu = sun @ normal, obs @ normal
        change, other = (mu0, mu) if case == "illumination" else (mu, mu0)
        if other.min() <= 0.0:
            continue
        rises = []
        for site in np.unique(curve.site):
            rows = np.flatnonzero(curve.site == site)
            on = change[rows] > 0
            inner = slice(len(rows) // 5, -len(rows) // 5)
            rises.append(on[-1] and not on[0] and on[inner].any() and not on[inner].all())
        if all(rises) and (mu0 * mu).max() > best:
            best, best_normal = float((mu0 * mu).max()), normal
    if best_normal is None:
        raise SystemExit(f"no facet shows a change of {case} alone in this pass")
    return best_normal


def main() -> None:
    args = _script.parser(__doc__ or "").parse_args()
    what = scenario.load(SCENARIO)
    curve = epochs(what.geometry)
    figure = _script.figure(8.2, 3.4)
    panels = figure.subplots(1, 2, sharey=True)
    for case, axes in zip(CASES, panels, strict=True):
        normal = normal_of(case, curve, what.attitude)
        here = replace(what, body=what.body._replace(normals=normal[None]))
        flux = flux_at(here, curve.t, curve.sun, curve.obs, ephemeris(curve))
        m = photometry.magnitude(jnp.asarray(flux), RANGE_M, photometry.sun_magnitude("V"))
        for site, hue in (("Maui", style.INK), ("Kauai", style.PALETTE[0])):
            rows = np.flatnonzero(curve.site == site)
            axes.plot(curve.t[rows], np.asarray(m)[rows], color=hue, lw=1.4, label=site)
            first = rows[np.argmax(flux[rows] > 0)]
            print(f"{case}: from {site} it appears at t = {curve.t[first]:.0f} s")
        seen, _ = simulate(here, args.seed)
        result = single_facet(seen, what.attitude)
        print("\n".join([*map(str, result.reasons), *single_facet_report.words(result)]))
        axes.set_title(
            {
                "illumination": "the facet comes into sunlight",
                "visibility": "the facet comes into view",
            }[case],
            loc="left",
        )
        axes.set_xlabel("time (s)")
    panels[0].set_ylabel("V magnitude at 1,000 km")
    panels[0].set_ylim(13.0, 5.0)
    panels[0].legend(loc="upper left")
    _script.save(figure, args.out, "hall_figure2")


if __name__ == "__main__":
    main()
