"""Figure 3 of Hall et al. 2007: brightness over phase angle of cube, tetrahedron and cylinder.

Every point is one random orientation and illumination. Each body has a circumscribed sphere of 1 m
diameter and reflects 30 % by Lambert's law and 30 % in a lobe (Blinn-Phong, exponent 100: the paper
does not specify the lobe). Directions to Sun and observer are independent and uniform. Magnitudes
are at 1,000 km.
"""

from __future__ import annotations

import _script
import numpy as np

from lcbayes.analysis import style
from lcbayes.core.jax_setup import jnp
from lcbayes.inversion.separated.shape_match import Surface, reflected_flux, turned
from lcbayes.physics import photometry
from lcbayes.physics.bodies import shapes

RANGE_M = 1e6
DIAMETER = 1.0
HEIGHT = DIAMETER * 3.0 / np.sqrt(10.0)  # of a cylinder with length three times its diameter
BODIES = {
    "cube": shapes.cube(DIAMETER / np.sqrt(3.0)),
    "tetrahedron": shapes.tetrahedron(DIAMETER * np.sqrt(2.0 / 3.0)),
    "cylinder, 3 : 1": shapes.cylinder(HEIGHT / 6.0, HEIGHT, 144),
}


def main() -> None:
    parser = _script.parser(__doc__ or "", draws=100_000)
    args = parser.parse_args()
    rng = np.random.default_rng(args.seed)
    figure = _script.figure(9.0, 3.2)
    panels = figure.subplots(1, 3, sharex=True, sharey=True)
    for k, ((name, body), axes) in enumerate(zip(BODIES.items(), panels, strict=True)):
        phase = np.arccos(rng.uniform(-1.0, 1.0, args.draws))
        flux = reflected_flux(body, Surface(), *turned(phase, rng))
        m = np.asarray(
            photometry.magnitude(jnp.asarray(flux), RANGE_M, photometry.sun_magnitude("V"))
        )
        kept = np.isfinite(m)
        axes.plot(
            np.degrees(phase[kept]), m[kept], ",", alpha=0.5, color=style.colour(k), rasterized=True
        )
        axes.set_title(name, loc="left")
        axes.set_xlabel("phase angle (deg)")
        print(f"{name}: {np.mean(~kept):.1%} of the draws send nothing")
    panels[0].set_ylabel("V magnitude at 1,000 km")
    panels[0].set_ylim(18.0, 3.0)
    panels[0].set_xlim(0.0, 180.0)
    panels[0].set_xticks([0, 45, 90, 135, 180])
    _script.save(figure, args.out, "hall_figure3")


if __name__ == "__main__":
    main()
