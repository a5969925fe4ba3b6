"""Options of `lcbayes shape-match`."""

from __future__ import annotations

from dataclasses import dataclass

from lcbayes.core.errors import InputError
from lcbayes.core.options import Options, option
from lcbayes.tasks.task import Task


@dataclass(frozen=True)
class ShapeMatchOptions(Options):
    """Options of `lcbayes.shape_match`."""

    shape: tuple[str, ...] = option(
        (),
        metavar="NAME|FILE.obj",
        help="a candidate, may be given several times; by default all built-in shapes",
    )
    r_diff: float = option(0.3, low=0.0, high=1.0, metavar="R", help="diffuse reflectance")
    r_spec: float = option(0.3, low=0.0, high=1.0, metavar="R", help="specular reflectance")
    exponent: float = option(
        100.0, low=1.0, high=1000.0, metavar="N", help="exponent of the Blinn-Phong specular lobe"
    )
    level: float = option(
        0.05,
        low=0.001,
        below=1.0,
        metavar="P",
        help="reject candidates with a p-value below this one",
    )
    seed: int = option(0, low=0, help="seed of the random orientations")

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0.0 < self.r_diff + self.r_spec <= 1.0:
            raise InputError(
                f"--r-diff {self.r_diff:g} and --r-spec {self.r_spec:g}: expected a sum > 0 and "
                "<= 1"
            )


TASK = Task(
    name="shape-match",
    details="""\
examples:
  lcbayes shape-match passes.csv --tle object.tle -o out
  lcbayes shape-match passes.csv -o out --shape cube --shape cylinder --shape model.obj \\
      --r-diff 0.2 --r-spec 0.4 --exponent 50

For tumbling objects seen often: orientations must be as good as random. Shapes are
cube, tetrahedron, cylinder (3:1), sphere, plate, box-wing, rocket-body, or OBJ files.
Size is not used.
Written: report.html, summary.json, tables/, figures/, run.toml.
""",
    options=ShapeMatchOptions,
    fully_lit=True,
)
