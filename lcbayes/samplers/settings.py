"""Settings of the samplers and their defaults."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

from lcbayes.core.errors import InputError

# The samplers and their default warm-up. The kernels of this package adapt more parameters than
# NUTS. Particles need no warm-up, because they start from the prior.
AUTO, NUTS, FACET_MOVES, GUIDED = "auto", "nuts", "facet-moves", "guided"
WARMUP = {
    AUTO: 200,
    NUTS: 200,
    FACET_MOVES: 200,
    GUIDED: 200,
    "ahmc": 600,
    "ahmc-paper": 600,
    "hmc": 600,
    "rmhmc": 600,
    "mh": 2000,
    "smc": 0,
}
PARTICLES = "smc"
DRAWS, MOVING = 750, 250  # defaults: draws of a chain, moving particles
MAX_DRAWS = 3000  # default limit of a chain, which is extended until it has converged
# Limits of chains that mix slowly, but whose draws are cheap.
MANY_DRAWS = {FACET_MOVES: 12_000, GUIDED: 6000}
PUBLISHED = "ahmc-paper"  # kept for comparison: it does not leave the posterior invariant


@dataclass(frozen=True)
class Settings:
    """Settings of a run.

    Attributes
    ----------
    sampler : name of the kernel; "auto" selects facet-moves for models that have such moves, guided
        for those with a cheaper density that is similar, and nuts for others
    seed : seed of all random numbers
    num_warmup : per chain; None selects the default of the sampler, `WARMUP`
    num_samples : per chain; 0 selects 750 and, until convergence, extends them to at most 3000,
        12000 for facet-moves or 6000 for guided, of which at most 3000 are kept at even intervals;
        for smc, the number of moving particles, with 0 for 250
    num_chains : per solution; for smc, the number of independent runs
    num_starts : starting points of the search if the model does not provide them; 0 selects them by
        dimension
    max_modes : maximum number of sampled solutions
    most_samples : maximum number of draws per chain
    own_warmup : whether num_warmup is the default of the sampler
    """

    sampler: str = AUTO
    seed: int = 0
    num_warmup: int | None = None
    num_samples: int = 0
    num_chains: int = 4
    num_starts: int = 0
    max_modes: int = 4
    most_samples: int = field(init=False)
    own_warmup: bool = field(init=False, compare=False)

    def __post_init__(self) -> None:
        if self.sampler not in WARMUP:
            raise InputError(f"unknown sampler {self.sampler!r}; available: {', '.join(WARMUP)}")
        object.__setattr__(self, "own_warmup", self.num_warmup is None)
        if self.own_warmup:
            object.__setattr__(self, "num_warmup", WARMUP[self.sampler])
        most = self.num_samples
        if self.num_samples == 0:
            number = DRAWS
            if self.sampler == PARTICLES:
                number = most = MOVING
            else:
                most = MANY_DRAWS.get(self.sampler, MAX_DRAWS)
            object.__setattr__(self, "num_samples", number)
        object.__setattr__(self, "most_samples", most)
        least = {
            "num_warmup": 10,
            "num_samples": 10,
            "num_chains": 1,
            "num_starts": 0,
            "max_modes": 1,
            "seed": 0,
        }
        if self.sampler == PARTICLES:  # only another run reveals a solution that one run has lost
            least |= {"num_warmup": 0, "num_chains": 2}
        for name, low in least.items():
            value = getattr(self, name)
            if not isinstance(value, int) or value < low:
                flag = name.replace("_", "-")
                raise InputError(f"--{flag} is {value!r}; give a whole number >= {low}")

    def with_sampler(self, name: str) -> Settings:
        """The same settings with another kernel, and its own defaults where none were given."""
        asked = self.as_dict()
        asked["sampler"] = name
        return Settings(**asked)

    def as_dict(self) -> dict[str, Any]:
        """The requested settings, from which the same object can be constructed."""
        asked = asdict(self)
        if asked.pop("most_samples") > self.num_samples:
            asked["num_samples"] = 0
        if asked.pop("own_warmup"):
            asked["num_warmup"] = None
        return asked
