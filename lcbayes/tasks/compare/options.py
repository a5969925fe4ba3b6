"""Options of `lcbayes compare`."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from lcbayes.core.errors import InputError
from lcbayes.core.options import option
from lcbayes.modelling.options import ModelOptions
from lcbayes.tasks.fit.options import MODEL, model_file
from lcbayes.tasks.task import Task

PARTICLES, CHAINS = "particles", "chains"
MOST = 50  # facets; a guard against typing errors, far above what data can resolve


def numbers(text: str) -> tuple[int, ...]:
    """The numbers of "1-8", "1,2,4" or "1-3,6".

    Raises
    ------
    InputError
    """
    found: list[int] = []
    for part in text.split(","):
        ends = re.fullmatch(r"\s*(\d{1,4})(?:-(\d{1,4}))?\s*", part)
        if ends is None or int(ends[2] or ends[1]) < int(ends[1]):
            raise InputError(
                f"--n-facets is {text!r}: {part!r} is no number or range; expected 1-8 or 1,2,4"
            )
        found += range(int(ends[1]), int(ends[2] or ends[1]) + 1)
    return tuple(found)


@dataclass(frozen=True)
class CompareOptions(ModelOptions):
    """Options of `lcbayes.compare`, with those of the model."""

    n_facets: tuple[int, ...] = option(  # pyright: ignore[reportIncompatibleVariableOverride]
        tuple(range(1, 9)),
        parse=numbers,
        metavar="N-M",
        aliases=("--facets",),
        help="numbers of facets to compare: 1-8 or 1,2,4",
    )
    facets: None = None  # facets of known normals have a known number
    model: str = MODEL
    seed: int = option(0, low=0, help="seed of all random numbers")
    num_particles: int = option(100, low=10, help="particles that move, in each run")
    num_runs: int = option(4, low=2, help="independent runs for each number of facets")
    num_starts: int = option(0, low=0, help="starts of the search for the best fit; 0: 64")
    evidence: str = option(
        PARTICLES,
        choices=(PARTICLES, CHAINS),
        help="chains: chains and bridges where these agree, particles for the other numbers",
    )
    sparse: int | None = option(
        None, low=2, help="upper bound of facets from which to take the sparse path too"
    )

    def __post_init__(self) -> None:
        if isinstance(self.n_facets, range | set | frozenset):
            object.__setattr__(self, "n_facets", tuple(self.n_facets))
        super().__post_init__()
        counts = tuple(sorted(set(self.n_facets)))
        shown = ",".join(map(str, counts)) or "empty"
        if len(counts) < 2:
            raise InputError(
                f"--n-facets is {shown}; give two numbers or more to compare, such as 1-8 or 2,3,5"
            )
        if counts[0] < 1 or counts[-1] > MOST:
            raise InputError(f"--n-facets is {shown}; give numbers from 1 to {MOST}")
        object.__setattr__(self, "n_facets", counts)

    def files(self) -> dict[str, Path]:
        return super().files() | model_file(self.model)


TASK = Task(
    name="compare",
    summary="how many facets: evidence, left-out epochs and probability of each number",
    details="""\
examples:
  lcbayes compare pass.csv --n-facets 1-8 -o out
  lcbayes compare pass.csv --n-facets 2,3,4 --num-particles 2000 --num-runs 8 -o out
  lcbayes compare pass.csv --n-facets 1-4 --sparse 10 -o out
  lcbayes compare passes.csv --n-facets 1-4 --evidence chains -o out
  lcbayes compare starlink.csv --n-facets 1-3 --model stabilised -o out
  lcbayes compare glint.csv --n-facets 1-4 --model faceted-brdf --reflectance cook-torrance -o out

Evidences and predictive densities are natural logarithms (nat). Each number of
facets is as likely as the others before the data. The exit status is 3 where the
independent runs differ too much for a conclusion, or the particles lost their way.

--evidence chains searches the solutions of each number, samples each with --num-runs
chains, and gives the evidence by bridge sampling. Where chains disagree, a bridge is
uncertain by more than 0.3 nat, or a solution may be missing, particles are used.
A run that was stopped goes on when the same command is given again.
""",
    options=CompareOptions,
)
