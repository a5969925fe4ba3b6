"""Reference posteriors: python -m tests.reference.make writes posteriors.json anew, in minutes.

Each posterior is computed twice. What the tests compare with uses no Markov chain: quadrature in
two and three dimensions, importance sampling in more, on NumPyro's own density of the model. Beside
it stand four long chains of NUTS by `lcbayes.fit`, worth 20,000 draws or more. The two must agree:
the command ends with an error, and writes nothing, where the largest of all differences would be
reached by chance less than once in 10,000 times.
"""

from __future__ import annotations

import json
import sys
import time
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

import numpy as np

import lcbayes
from lcbayes.core.checkpoint import write_atomic
from tests.reference import agreement, independent
from tests.reference.agreement import Moments
from tests.reference.problems import ALL, Reference
from tests.reference.stored import WRITTEN, identity

COMMAND = "python -m tests.reference.make"
SEED = 20
CHAINS, LENGTH, STRETCHES = 4, 25_000, 25
LONGER = {"banana": 50_000}  # the arms of the ridge are visited seldom
DRAWS = 400_000  # of importance sampling
POINTS = {"one-facet": (160, 240), "stabilised": (60, 90), "banana": (300, 500)}
GRID_ERROR = 1e-6  # posterior sd, between two grids
WORTH = 20_000  # draws, at least, of the long chains
FALSE_ALARM = 1e-4


def main() -> None:
    problems = {one.name: record(one) for one in ALL}
    moments = {
        "command": COMMAND,
        "date": datetime.now(UTC).date().isoformat(),
        "problems": problems,
    }
    text = json.dumps(moments, indent=1) + "\n"
    write_atomic(WRITTEN, lambda path: path.write_text(text, encoding="utf-8"))


def record(one: Reference) -> dict[str, Any]:
    """Both computations of one posterior, which must agree."""
    begun, length = time.process_time(), LONGER.get(one.name, LENGTH)
    result = lcbayes.fit(
        one.curve, model=one.model, seed=SEED, num_samples=length, num_chains=CHAINS, **one.options
    )
    names, draws, sites = one.draws(result)
    density = independent.Density(one, {k: v[:: len(v) // 4000] for k, v in sites.items()})
    method, known = exact(one, density)
    assert known.names == names
    both = agreement.compare(draws, known, STRETCHES)
    limit, worst = both.limit(FALSE_ALARM / len(ALL)), float(np.max(np.abs(both.pulls)))
    zero = np.zeros(len(names))
    alone = agreement.compare(draws, replace(known, mean_se=zero, log_sd_se=zero), STRETCHES)
    worth = 1.0 / np.maximum(alone.bias_se**2, 2.0 * alone.stretch_se**2)
    print(
        f"{one.name}: {method}; chains worth {worth.min():.0f} draws, worst pull {worst:.1f} of "
        f"{limit:.1f}; {time.process_time() - begun:.0f} s of one core",
        flush=True,
    )
    if worst > limit or worth.min() < WORTH:
        sys.exit(f"{one.name}: the two computations differ, or the chains are worth too little")
    sd = known.sd * np.exp(alone.stretch)
    chains = Moments(
        names, known.mean + known.sd * alone.bias, sd, known.sd * alone.bias_se, alone.stretch_se
    )
    return identity(one) | {
        "shape": one.shape,
        "method": method,
        "nuts": {"seed": SEED, "num_chains": CHAINS, "num_samples": length},
        "quantities": {
            name: row(known, i, "") | row(chains, i, "nuts_") for i, name in enumerate(names)
        },
    }


def exact(one: Reference, density: independent.Density) -> tuple[str, Moments]:
    """Without chains: how, and the moments."""
    if one.name not in POINTS:
        known, worth = independent.importance(density, DRAWS, SEED)
        return f"importance sampling, {DRAWS} draws worth {worth:.0f}", known
    coarse, fine = (
        independent.one_facets(one, n)
        if one.name == "one-facet"
        else independent.quadrature(density, n)
        for n in POINTS[one.name]
    )
    apart = np.abs([coarse.mean - fine.mean, coarse.sd - fine.sd]) / fine.sd
    if apart.max() > GRID_ERROR:
        sys.exit(f"{one.name}: two grids differ by {apart.max():.1e} sd; take more points")
    return f"quadrature, {POINTS[one.name][1]} points along each axis", fine


def row(moments: Moments, i: int, prefix: str) -> dict[str, float]:
    values = {
        "mean": moments.mean[i],
        "mean_se": moments.mean_se[i],
        "sd": moments.sd[i],
        "sd_se": moments.sd[i] * moments.log_sd_se[i],
    }
    return {prefix + k: round(float(f"{v:.9g}"), 12) for k, v in values.items()}


if __name__ == "__main__":
    main()
