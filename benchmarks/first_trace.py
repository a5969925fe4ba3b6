"""Time until the parameters of a model are known, traced and run operation by operation.

python benchmarks/first_trace.py

Each time is that of a new process without a compilation cache, after the light curve was read:
`Problem` traces the model; `numpyro.infer.util.initialize_model`, which NumPyro's MCMC calls first,
runs it. Both then know the sites, their supports and the shape of the unconstrained vector.
"""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from _results import table, write_section

RUNS = 3
CASES = {  # scenario, model, options
    "two facets, constant spin": ("two-facet-spin", "faceted", {"n_facets": 2}),
    "two facets with a specular law": ("two-facet-spin", "faceted-brdf", {"n_facets": 2}),
    "rocket stage with shadows": ("two-facet-spin", "body", {"body": "rocket-stage"}),
    "box and wing with shadows": ("two-facet-spin", "body", {"body": "box-wing"}),
}
WAYS = ("traced", "run")


def seconds(name: str, way: str) -> float:
    """Time in this process."""
    import lcbayes
    from lcbayes.core.jax_setup import jax
    from lcbayes.modelling import registry
    from lcbayes.modelling.epochs import Epochs
    from lcbayes.modelling.problem import Problem

    jax.config.update("jax_enable_compilation_cache", False)
    scenario, model, given = CASES[name]
    data = Epochs.of(lcbayes.simulate(scenario, seed=1).data)
    entry = registry.find(model)
    options: dict[str, Any] = entry.check(given)
    bound = entry.bind(options)
    begun = time.perf_counter()
    if way == "traced":
        Problem(bound, data)
    else:
        from numpyro.infer.util import initialize_model

        initialize_model(jax.random.key(0), bound, model_args=(data,))
    return time.perf_counter() - begun


def in_a_new_process(name: str, way: str) -> float:
    words = [sys.executable, __file__, name, way]
    done = subprocess.run(words, check=True, capture_output=True, text=True)
    return float(done.stdout.split()[-1])


def main() -> None:
    rows = []
    for name in CASES:
        took = [min(in_a_new_process(name, way) for _ in range(RUNS)) for way in WAYS]
        rows.append([name, *(f"{t:.1f}" for t in took), f"{took[1] / took[0]:.1f}"])
        print(*rows[-1], flush=True)
    heads = ["model", "`Problem` (s)", "`initialize_model` (s)", "ratio"]
    text = f"Best of {RUNS} new processes.\n\n{table(heads, rows)}"
    write_section("Parameters of a model", f"python benchmarks/{Path(__file__).name}", text)


if __name__ == "__main__":
    if len(sys.argv) == 3:
        print(seconds(*sys.argv[1:]))
    else:
        main()
