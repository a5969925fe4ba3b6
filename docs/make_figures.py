"""Make the figure of the README from the demo's results: `python docs/make_figures.py demo`."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt

from lcbayes.analysis import contents, light_curve_plots, quantities, style
from lcbayes.analysis.numerals import show

OUT = Path(__file__).parent / "figures" / "demo.png"


def main(folder: Path) -> None:
    results = contents.read(folder)
    best = results.modes[0]
    q = light_curve_plots.bands(best)
    assert q is not None
    plt.rcParams.update(style.RC | {"svg.fonttype": "none"})
    figure = plt.figure(figsize=(9.0, 3.3), layout="constrained")
    left = figure.add_subplot(1, 2, 1)
    right = figure.add_subplot(1, 2, 2, projection="mollweide")
    power = 10.0 ** np.floor(np.log10(results.brightness.max()))
    for i, part in enumerate(light_curve_plots.segments(results)):
        at, x = part.points, results.t[part.points] / 60.0
        hue = style.colour(i)
        left.fill_between(x, q[0, at] / power, q[4, at] / power, color=hue, alpha=0.45, lw=0)
        left.plot(x, results.brightness[at] / power, ".", ms=4, color=hue, label=part.site)
    left.set_xlabel("minutes")
    left.set_ylabel(f"flux (10$^{{{int(np.log10(power))}}}$ W/m²)")
    left.set_title("light curve; bands: 90 % of what the posterior predicts", loc="left")
    left.legend()
    normals = quantities.facet_normals(best)
    assert normals is not None
    for i, facet in enumerate(quantities.facets(results, best)):
        u = normals[:, :, i].reshape(-1, 3)[::5]
        lon, lat = (np.radians(x) for x in quantities.lon_lat(u))
        lon = (lon + np.pi) % (2 * np.pi) - np.pi
        right.plot(lon, lat, ".", ms=2, alpha=0.4, color=style.colour(i))
        x, y = (np.radians(x) for x in quantities.lon_lat(u.mean(axis=0)))
        x = (x + np.pi) % (2 * np.pi) - np.pi
        area = f"{show(facet.area.mean, facet.area.sd)} ± {show(facet.area.sd, facet.area.sd)} m²"
        away = (0, -15) if y > 1 or x > 2.5 else (0, 9)  # inside the map, clear of the others
        align = "right" if x > 2.5 else "center"
        right.annotate(
            area,
            (float(x), float(y)),
            away,
            textcoords="offset points",
            ha=align,
            fontsize=8,
            color=style.colour(i),
        )
    right.grid(color="#d5d8dd", lw=0.5)
    right.set_axisbelow(True)
    right.set_longitude_grid_ends(90)
    right.set_xticklabels([])
    right.set_yticklabels([])
    right.set_title("where the facets face, and their albedo-areas", loc="left")
    OUT.parent.mkdir(exist_ok=True)
    figure.savefig(OUT, dpi=130)
    print(OUT)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "demo"))
