"""Options of `lcbayes albedo-area`."""

from __future__ import annotations

from dataclasses import dataclass

from lcbayes.core.options import option
from lcbayes.tasks.attitude import AttitudeOptions
from lcbayes.tasks.task import Task


@dataclass(frozen=True)
class AlbedoAreaOptions(AttitudeOptions):
    """Options of `lcbayes.albedo_area`."""

    material: tuple[str, ...] = option(
        ("lambertian",),
        metavar="LAW[:NAME=VALUE,...]",
        help="a reflecting component, may be given several times",
    )
    n_normals: int = option(400, low=50, help="normals of the grid; at least 50 normals")
    smoothness: float = option(
        0.0,
        low=0.0,
        metavar="W",
        help="weight of smoothness over the grid; 0 for bodies with edges",
    )
    facet_cost: float | None = option(
        None,
        low=0.0,
        metavar="CHI2",
        help="decrease of chi2 for which a facet is kept; by default 3 ln N of the N points",
    )
    albedo: float = option(
        1.0, above=0.0, metavar="A", help="albedo of all facets, for the size of the shape"
    )
    bootstrap: int = option(100, low=0, help="resampled data sets; 0 leaves them out")
    nulls: int = option(
        199, low=0, help="simulated bodies for each null of the shape cues; 0 leaves the cues out"
    )
    seed: int = option(0, low=0, help="seed of the resampling and of the simulated bodies")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.material != ("lambertian",):
            from lcbayes.inversion.albedo_area.kernel import Material

            for text in self.material:
                Material.parse(text)


TASK = Task(
    name="albedo-area",
    details="""\
examples:
  lcbayes albedo-area pass.csv --attitude none -o out
  lcbayes albedo-area pass.csv --omega 0,0,0.1 -o out \\
      --material lambertian --material blinn-phong:n=50
  lcbayes albedo-area 43_Ariadne.lcs --pole 253.2,-17.2 --period 5.76198 -o out \\
      --material lommel-seeliger-lambert --smoothness 1

The attitude is taken as known. Each --material is a column: a law with its
parameters but for the reflectance, which is solved for together with the area.
Written: report.html, summary.json, tables/, figures/, run.toml, and shape.obj and
shape.ply where the facets close.
""",
    options=AlbedoAreaOptions,
    fully_lit=True,
)
