"""Options of `lcbayes compare`."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from lcbayes.core.errors import InputError
from lcbayes.core.options import option
from lcbayes.modelling.options import ModelOptions
from lcbayes.tasks.fit.options import MODEL, model_file
from lcbayes.tasks.task import Task

PARTICLES, CHAINS = "particles", "chains"
FACETS = "facets"
COUNTS = tuple(range(1, 9))
MOST = 50  # facets; a guard against typing errors, far above what data can resolve


def numbers(text: str) -> tuple[int, ...]:
    """The numbers of "1-8", "1,2,4" or "1-3,6".

    Raises
    ------
    InputError
    """
    counts: list[int] = []
    for part in text.split(","):
        ends = re.fullmatch(r"\s*(\d{1,4})(?:-(\d{1,4}))?\s*", part)
        if ends is None or int(ends[2] or ends[1]) < int(ends[1]):
            raise InputError(
                f"--n-facets is {text!r}: {part!r} is no number or range; expected 1-8 or 1,2,4"
            )
        counts += range(int(ends[1]), int(ends[2] or ends[1]) + 1)
    return tuple(counts)


def kinds_of(bodies: Sequence[str]) -> list[tuple[str, int]]:
    """Each kind of body with its number of facets, 0 for a known body.

    "facets:3-4" stands for two kinds, of three and of four facets.

    Raises
    ------
    InputError
    """
    kinds: list[tuple[str, int]] = []
    for name in bodies:
        start, colon, listed = name.partition(":")
        if start == FACETS and colon:
            kinds += [(f"{FACETS}:{n}", n) for n in numbers(listed)]
        else:
            kinds.append((name, 0))
    return list(dict.fromkeys(kinds))


@dataclass(frozen=True)
class CompareOptions(ModelOptions):
    """Options of `lcbayes.compare`, with those of the model."""

    n_facets: tuple[int, ...] = option(  # pyright: ignore[reportIncompatibleVariableOverride]
        COUNTS,
        parse=numbers,
        metavar="N-M",
        aliases=("--facets",),
        help="numbers of facets to compare: 1-8 or 1,2,4",
    )
    facets: None = None  # facets of known normals have a known number
    body: None = None  # several are compared with --bodies
    bodies: tuple[str, ...] = option(
        (),
        several=True,
        metavar="BODY",
        help="kinds of body to compare: known bodies by name or file, and facets:N-M",
    )
    model: str = MODEL
    seed: int = option(0, low=0, help="seed of all random numbers")
    num_particles: int = option(100, low=10, help="particles that move, in each run")
    num_runs: int = option(4, low=2, help="independent runs for each number of facets")
    num_starts: int = option(0, low=0, help="starts of the search for the best fit; 0: 64")
    evidence: str = option(
        CHAINS,
        choices=(CHAINS, PARTICLES),
        help="chains: chains and bridges where these agree, particles for the other numbers",
    )
    sparse: int | None = option(
        None, low=2, help="upper bound of facets from which to take the sparse path too"
    )

    def __post_init__(self) -> None:
        if isinstance(self.n_facets, range | set | frozenset):
            object.__setattr__(self, "n_facets", tuple(self.n_facets))
        super().__post_init__()
        if self.bodies:
            self._check_bodies()
            return
        counts = tuple(sorted(set(self.n_facets)))
        shown = ",".join(map(str, counts)) or "empty"
        if len(counts) < 2:
            raise InputError(
                f"--n-facets is {shown}; give two numbers or more to compare, such as 1-8 or 2,3,5"
            )
        if counts[0] < 1 or counts[-1] > MOST:
            raise InputError(f"--n-facets is {shown}; give numbers from 1 to {MOST}")
        object.__setattr__(self, "n_facets", counts)

    def _check_bodies(self) -> None:
        """Raise an InputError if the kinds of body cannot be compared."""
        if self.n_facets != COUNTS:
            raise InputError(
                "--n-facets and --bodies are both given; give numbers of facets as --bodies "
                "facets:2-4, beside other bodies"
            )
        if self.sparse is not None:
            raise InputError("--sparse goes with --n-facets; leave it out, or leave out --bodies")
        kinds = kinds_of(self.bodies)
        if len(kinds) < 2:
            raise InputError(
                f"--bodies is {' '.join(self.bodies)}; give two kinds of body or more, such as "
                "rocket-stage facets:3-4"
            )
        if not all(n <= MOST for _, n in kinds):
            raise InputError(f"--bodies gives more than {MOST} facets; give fewer")

    def files(self) -> dict[str, Path]:
        paths = {f"body_{i + 1}": Path(name) for i, name in enumerate(self.bodies)}
        bodies = {k: path for k, path in paths.items() if path.suffix == ".toml"}
        return super().files() | model_file(self.model) | bodies


TASK = Task(
    name="compare",
    details="""\
examples:
  lcbayes compare pass.csv --n-facets 1-8 -o out
  lcbayes compare pass.csv --n-facets 2,3,4 --num-runs 8 -o out
  lcbayes compare pass.csv --n-facets 1-4 --sparse 10 -o out
  lcbayes compare pass.csv --n-facets 1-3 --evidence particles --num-particles 500 -o out
  lcbayes compare starlink.csv --n-facets 1-3 --model stabilised -o out
  lcbayes compare pass.csv --bodies rocket-stage my.toml facets:3-4 -o out
  lcbayes compare glint.csv --n-facets 1-4 --model faceted-brdf --reflectance cook-torrance -o out

Evidences and predictive densities are natural logarithms (nat). Each number of
facets is as likely as the others before the data. The exit status is 3 where the
independent runs differ too much for a conclusion, or the particles lost their way.

The solutions of each number are searched and sampled with --num-runs chains, and bridge
sampling gives the evidence. Facets that the data do not determine are weighed by a bridge
to one facet fewer. Where chains disagree, a bridge is uncertain by more than 0.3 nat, or
a solution may be missing, particles go from the prior to the posterior instead, in
--num-runs runs; --evidence particles uses them alone, as a check, and takes far longer.
--bodies compares kinds of body, each as likely as the others before the data: known
bodies by name or TOML file, as for fit --model body, and numbers of facets of --model.
Options hold for the models that have them. The evidence is that of chains; where it
cannot be relied on it is kept, and the result says so.

A run that was stopped goes on when the same command is given again.
""",
    options=CompareOptions,
)
