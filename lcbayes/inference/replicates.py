"""Independent runs of tempered SMC, each saved to disk on completion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from lcbayes.core.checkpoint import Checkpoint
from lcbayes.core.jax_setup import jax
from lcbayes.core.progress import Silent
from lcbayes.core.reasons import Finding
from lcbayes.inference import symmetry
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.samplers import smc
from lcbayes.samplers.settings import Settings


def independent_runs(
    problem: Problem,
    data: Epochs,
    key: jax.Array,
    n_particles: int,
    n_runs: int,
    *,
    name: str,
    checkpoint: Checkpoint,
    **options: Any,
) -> list[smc.Result]:
    """`smc.replicate` with a checkpoint: stored runs under ``name`` are reused.

    Runs from the checkpoint have no ``stages``.

    Raises
    ------
    smc.Collapse, InputError
        From `smc.run`.
    """
    mirror = symmetry.plane_mirror(problem, data)
    runs = []
    for i, own in enumerate(jax.random.split(key, n_runs)):
        stored = checkpoint.load(f"{name}-{i}")
        if stored is None:
            result = smc.run(problem, data, own, n_particles, mirror=mirror, **options)
            stored = {
                "z": result.z,
                "log_likelihood": result.log_likelihood,
                "numbers": np.array([result.log_evidence, result.gradients, result.seconds]),
                "points": np.array(result.points),
                "reasons": np.array([r.encode() for r in result.reasons], dtype=str),
            }
            checkpoint.save(f"{name}-{i}", stored)
        log_evidence, gradients, seconds = stored["numbers"]
        runs.append(
            smc.Result(
                stored["z"],
                stored["log_likelihood"],
                float(log_evidence),
                [],
                int(stored["points"]),
                int(gradients),
                float(seconds),
                [Finding.decode(text) for text in stored["reasons"].tolist()],
            )
        )
    return runs


@dataclass(frozen=True)
class Execution:
    """Execution of SMC runs: settings, threads and storage of completed runs."""

    settings: Settings
    workers: int
    checkpoint: Checkpoint

    def runs(
        self,
        problem: Problem,
        data: Epochs,
        key: jax.Array,
        n_runs: int,
        name: str,
        progress: Silent,
    ) -> list[smc.Result]:
        """Independent runs of tempered SMC from the prior."""
        return independent_runs(
            problem,
            data,
            key,
            self.settings.num_samples,
            n_runs,
            name=name,
            checkpoint=self.checkpoint,
            workers=self.workers,
            progress=progress,
        )
