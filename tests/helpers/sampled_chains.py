"""Chains about one point of a posterior, as a fit samples them."""

from __future__ import annotations

import numpy as np

from lcbayes.core.checkpoint import Checkpoint
from lcbayes.core.jax_setup import jax
from lcbayes.core.progress import Silent
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.samplers import sampling
from lcbayes.samplers.settings import Settings


def sampled(
    problem: Problem,
    data: Epochs,
    settings: Settings,
    start,
    seed: int,
    checkpoint=None,
    guide=None,
) -> sampling.Chains:
    with Silent().stage("sampling", 1, "draws") as track:
        return sampling.Sampler(problem, settings, 1, guide=guide).run(
            "mode-0",
            np.asarray([start]),
            data,
            jax.random.key(seed),
            checkpoint or Checkpoint(None, {}),
            sampling.Timing(),
            track,
        )
