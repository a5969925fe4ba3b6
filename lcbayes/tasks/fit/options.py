"""Options of `lcbayes fit`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lcbayes.core.options import option
from lcbayes.modelling.options import ModelOptions, function_name
from lcbayes.tasks.task import Task

SAMPLERS = ("auto", "nuts", "ahmc", "smc")
MODEL = option(
    "faceted",
    help="faceted, faceted-brdf, convex-grid, contact-binary, stabilised, body, or a Python file",
    callables=True,
)


@dataclass(frozen=True)
class FitOptions(ModelOptions):
    """Options of `lcbayes.fit`, with those of the model."""

    model: str = MODEL
    sampler: str = option(
        "auto",
        choices=SAMPLERS,
        help="NUTS, Fisher-adaptive HMC, or particles from the prior for posteriors with many "
        "solutions; auto: NUTS, or for three and more facets Fisher-adaptive HMC with moves of "
        "single facets",
    )
    seed: int = option(0, low=0, help="seed of all random numbers")
    num_warmup: int | None = option(
        None, low=0, help="warm-up draws per chain; by default 600 for ahmc, 200 for others"
    )
    num_samples: int = option(
        0,
        low=0,
        help="draws per chain, or particles that move for smc; 0: 750, or up to 3000 where "
        "these are too few (12000 with facet-moves, 6000 with guided); 250 particles",
    )
    num_chains: int = option(4, low=1, help="chains per solution, or independent runs for smc")
    num_starts: int = option(
        0,
        low=0,
        help="starts of the search from the prior; 0: all spins of diffuse facets are visited, "
        "and for other models the number of parameters decides",
    )
    max_modes: int = option(
        4,
        low=1,
        help="largest number of solutions to sample; of rotations of facets, up to twice as many "
        "if these are all",
    )
    sparse: int | None = option(
        None,
        low=2,
        metavar="N",
        help="find the number of facets, at most N, under a squared-L1 prior, and fit with it",
    )
    start_from: Path | None = option(
        None,
        metavar="DIR",
        help="results of lcbayes scan or lcbayes spin, whose spins the search starts from",
    )

    def files(self) -> dict[str, Path]:
        return super().files() | model_file(self.model)

    def as_dict(self) -> dict[str, Any]:
        """Names and values for ``run.toml``; a function by its name."""
        values = super().as_dict()
        if callable(self.model):
            values["model"] = function_name(self.model)
        return values


def model_file(model: str) -> dict[str, Path]:
    """The file of a model that is not built in, in the form of `Options.files`."""
    if callable(model):
        return {}
    path = Path(model)
    return {"model": path} if path.suffix == ".py" or path.is_file() else {}


TASK = Task(
    name="fit",
    details="""\
examples:
  lcbayes fit pass.csv -o out --n-facets 3 --seed 1
  lcbayes fit pass.csv -o out --sparse 8          # finds the number of facets first
  lcbayes fit passes.csv -o out --n-facets 3 --period 20-30s --pole 120,-45,20
  lcbayes fit passes.csv -o out --n-facets 3 --start-from spin
  lcbayes fit passes.csv -o out --model body --body my.toml --start-from spin
  lcbayes fit 43_Ariadne.lcs --model convex-grid --period 5.762 -o out
  lcbayes fit pass.csv -o out --n-facets 4 --sampler smc
  lcbayes fit starlink.csv -o out --model stabilised
  lcbayes fit pass.csv --tle object.tle -o out --model stabilised --law lvlh --facets +z,-x~5
  lcbayes fit pass.csv -o out --model ./mine.py --set depth=0.3
  lcbayes fit --config out/run.toml -o again        # the same numbers

A run that was stopped goes on when the same command is given again.
`lcbayes models NAME` lists the options of a model.

--period is sidereal, and both senses of rotation are possible. A single value is
taken to be uncertain by 1 %, and by the rate of the phase-angle bisector, because a
period seen in the brightness is synodic; 23.70+-0.02s sets another width. A range is
uniform in ln P, and several periods are separated by commas: 22s,44s. --pole gives a
region of the sky (GCRS) that holds the pole or its opposite. Both replace the prior
of omega, and the search visits these spins alone.

--sparse N: the prior exp(-w (sum of albedo-areas)^2) shrinks facets that the data
do not require; w costs 50 nats for the areas of the best fit (--set sparsity=W sets
another). Facets below 2 % of the total are dropped, and facets whose normals agree
within two standard deviations are merged. The rest are fitted without that prior.
""",
    options=FitOptions,
)
