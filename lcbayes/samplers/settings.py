"""How a fit is run: what the user may turn, with defaults that serve."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

from lcbayes.core.errors import InputError

# The samplers, and a warm-up that serves each: the exact kernels have more to find than NUTS.
# Particles have no warm-up: they come from the prior.
WARMUP = {
    "nuts": 200,
    "ahmc": 600,
    "ahmc-paper": 600,
    "hmc": 600,
    "rmhmc": 600,
    "mh": 2000,
    "smc": 0,
}
PARTICLES = "smc"
DRAWS, MOVING = 750, 250  # by default: draws of a chain, particles that move
MAX_DRAWS = 3000  # of a chain, where by default it goes on until there are enough
PUBLISHED = "ahmc-paper"  # kept for comparison: it does not leave the posterior invariant


@dataclass(frozen=True)
class Settings:
    """Numbers of a run.

    Attributes
    ----------
    sampler : name of the kernel
    seed : of every random number drawn
    num_warmup : per chain; None takes what serves the sampler, `WARMUP`
    num_samples : per chain; 0 takes 750, and goes on to 3000 at most while these are not enough;
        for smc the particles that move, 0 takes 250
    num_chains : per solution; for smc the independent runs
    num_starts : of the search, where the model does not choose its own; 0 chooses by dimension
    max_modes : solutions that are sampled, at most
    most_samples : per chain, at most
    """

    sampler: str = "nuts"
    seed: int = 0
    num_warmup: int | None = None
    num_samples: int = 0
    num_chains: int = 4
    num_starts: int = 0
    max_modes: int = 4
    most_samples: int = field(init=False)

    def __post_init__(self) -> None:
        if self.sampler not in WARMUP:
            raise InputError(f"unknown sampler {self.sampler!r}; available: {', '.join(WARMUP)}")
        if self.num_warmup is None:
            object.__setattr__(self, "num_warmup", WARMUP[self.sampler])
        most = self.num_samples
        if self.num_samples == 0:
            number, most = (MOVING, MOVING) if self.sampler == PARTICLES else (DRAWS, MAX_DRAWS)
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
        if self.sampler == PARTICLES:  # what one run has lost only another one shows
            least |= {"num_warmup": 0, "num_chains": 2}
        for name, low in least.items():
            value = getattr(self, name)
            if not isinstance(value, int) or value < low:
                flag = name.replace("_", "-")
                raise InputError(f"--{flag} is {value!r}; give a whole number >= {low}")

    def as_dict(self) -> dict[str, Any]:
        """What was asked for: the same settings again, if given back."""
        asked = asdict(self)
        if asked.pop("most_samples") > self.num_samples:
            asked["num_samples"] = 0
        return asked
