"""The samplers of samplers.py, each used as recommended and timed without compilation."""

from __future__ import annotations

import os
import re
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import numpyro
import numpyro.distributions as dist
from _posteriors import Posterior
from numpy.typing import NDArray
from numpyro import handlers
from numpyro.distributions import constraints
from numpyro.infer import NUTS
from numpyro.infer.mcmc import MCMCKernel

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.samplers import kernels
from lcbayes.samplers.kernels.adaptation import INFORM_EVERY

Floats = NDArray[np.float64]

N_CHAINS = 4
FISHER = 3.0  # gradient-equivalents of one Fisher matrix
DENSITY = 1.0 / 3.0  # gradient-equivalents of one density without its gradient
THIN = 5  # emcee steps between kept states of the walkers


class Length(NamedTuple):
    warmup: int
    draws: int


class Run(NamedTuple):
    """The run of one seed; in each pair, warm-up is first and draws second."""

    y: Floats  # (C, S, D), the draws
    gradients: tuple[float, float]  # gradient-equivalents, all chains
    seconds: tuple[float, float]
    chosen: str = ""


type Runner = Callable[[int], Run]  # of a seed


def numpyro_kernel(make: Callable[[Posterior], MCMCKernel], post: Posterior, n: Length) -> Runner:
    """Chains of one NumPyro kernel, in parallel on the cores, as in `lcbayes.fit`."""
    kernel = make(post)

    def advance(length: int, state, args):
        def body(state, _):
            state = kernel.sample(state, args, {})
            return state, (state.z["y"], state.num_steps, getattr(state, "num_metric", 0))

        return jax.lax.scan(body, state, length=length)

    begin = jax.jit(lambda key, y, args: kernel.init(key, n.warmup, {"y": y}, args, {}))
    begin = begin.lower(jax.random.key(0), jnp.zeros(post.dim), post.args).compile()
    state = begin(jax.random.key(0), jnp.zeros(post.dim), post.args)
    warm = jax.jit(partial(advance, n.warmup)).lower(state, post.args).compile()
    draw = jax.jit(partial(advance, n.draws)).lower(state, post.args).compile()
    informed = isinstance(kernel, kernels.AHMC | kernels.RMHMC)
    own = FISHER * (1 + -(-n.warmup // INFORM_EVERY)) if informed else 0.0  # those of the warm-up

    def one(key: jax.Array, y: jax.Array):
        before = time.perf_counter()
        state, (_, *used) = jax.block_until_ready(warm(begin(key, y, post.args), post.args))
        between = time.perf_counter()
        state, (y, *used_after) = jax.block_until_ready(draw(state, post.args))
        costs = (_cost(*used) + own, _cost(*used_after))
        return np.asarray(y), costs, (before, between, time.perf_counter()), state

    def run(seed: int) -> Run:
        y, costs, times, states = _side_by_side(one, post, seed)
        words = " / ".join(_chosen(kernel, state) for state in states)
        return Run(y, costs, times, words)

    return run


def _cost(num_steps: Any, num_metric: Any) -> float:
    return float(np.sum(num_steps) + FISHER * np.sum(num_metric))


def _chosen(kernel: MCMCKernel, state: Any) -> str:
    """δ, L and ε of one chain, from the kernel's own text."""
    if not isinstance(kernel, kernels.AHMC | kernels.RMHMC):
        return ""
    words = kernel.describe(state)
    result = re.search(r"(\d+) steps? of ([\d.e+-]+)", words)
    delta = re.search(r"delta = ([\w.]+)", words)
    assert result is not None
    text = f"{result[1]} × {result[2]}"
    text = f"δ {delta[1].replace('inf', '∞')}, {text}" if delta else text
    return f"{text} (stuck)" if "stuck" in words else text


def _side_by_side(one: Callable, post: Posterior, seed: int):
    """Draws, cost and seconds of N_CHAINS chains on the cores, and other output of each."""
    keys = jax.random.split(jax.random.key(seed), N_CHAINS)
    starts = post.starts(N_CHAINS, seed)
    begun = time.perf_counter()
    with ThreadPoolExecutor(min(os.cpu_count() or 1, N_CHAINS)) as pool:
        y, costs, times, rest = zip(*pool.map(one, keys, starts), strict=True)
    total = time.perf_counter() - begun
    # Chains wait for a core, so the wall time is divided in proportion to the time of each stage.
    took = np.sum([np.diff(t) for t in times], axis=0)
    seconds = total * took / took.sum()
    cost = np.sum(costs, axis=0)
    return np.stack(y), (cost[0], cost[1]), (seconds[0], seconds[1]), rest


def ahmc(post: Posterior) -> MCMCKernel:
    return kernels.AHMC(potential_fn=_of_dict(post.potential), fisher_fn=_of_dict(post.fisher))


def rmhmc(post: Posterior) -> MCMCKernel:
    return kernels.RMHMC(potential_fn=_of_dict(post.potential), fisher_fn=_of_dict(post.fisher))


def _of_dict(f: Callable[..., jax.Array]) -> Callable[..., jax.Array]:
    return lambda z, *args: f(z["y"], *args)


def nuts(post: Posterior, *, dense: bool) -> MCMCKernel:
    """NumPyro's NUTS with its defaults."""

    def model(whitening: Any, data: Any) -> None:
        flat = dist.ImproperUniform(constraints.real_vector, (), (post.dim,))
        y = jnp.asarray(numpyro.sample("y", flat))
        with handlers.block():  # its sites do not belong to this model
            density = -post.potential(y, whitening, data)
        numpyro.factor("posterior", density)

    return NUTS(model, dense_mass=dense)


def blackjax_nuts(post: Posterior, n: Length) -> Runner:
    """blackjax's NUTS after its window adaptation, both with their defaults."""
    blackjax = _imported("blackjax")

    def density(args):
        return lambda y: -post.potential(y, *args)

    def warm(key, y, args):
        adaptation = blackjax.window_adaptation(blackjax.nuts, density(args))
        (state, parameters), info = adaptation.run(key, y, num_steps=n.warmup)
        return state, parameters, info.info.num_integration_steps

    def draw(key, state, parameters, args):
        kernel = blackjax.nuts(density(args), **parameters)

        def body(state, key):
            state, info = kernel.step(key, state)
            return state, (state.position, info.num_integration_steps)

        return jax.lax.scan(body, state, jax.random.split(key, n.draws))[1]

    first = jax.random.key(0), jnp.zeros(post.dim), post.args
    shapes = jax.eval_shape(warm, *first)[:2]
    warm = jax.jit(warm).lower(*first).compile()
    draw = jax.jit(draw).lower(first[0], *shapes, post.args).compile()

    def one(key: jax.Array, y: jax.Array):
        key_warm, key_draw = jax.random.split(key)
        before = time.perf_counter()
        state, parameters, used = jax.block_until_ready(warm(key_warm, y, post.args))
        between = time.perf_counter()
        y, used_after = jax.block_until_ready(draw(key_draw, state, parameters, post.args))
        costs = float(np.sum(used)), float(np.sum(used_after))
        return np.asarray(y), costs, (before, between, time.perf_counter()), None

    def run(seed: int) -> Run:
        return Run(*_side_by_side(one, post, seed)[:3])

    return run


def emcee(post: Posterior, n: Length) -> Runner:
    """Goodman & Weare's ensemble sampler with its default move; walkers count as chains."""
    module = _imported("emcee")
    walkers = max(32, 4 * post.dim)
    density = jax.jit(jax.vmap(lambda y, *args: -post.potential(y, *args), (0, None, None)))

    def log_prob(y: Floats) -> Floats:
        result = np.asarray(density(jnp.asarray(y), *post.args))
        return np.where(np.isnan(result), -np.inf, result)

    for size in (walkers, walkers // 2):  # the two shapes that emcee evaluates
        log_prob(np.zeros((size, post.dim)))

    def run(seed: int) -> Run:
        sampler = module.EnsembleSampler(walkers, post.dim, log_prob, vectorize=True)
        random = np.random.RandomState(seed).get_state()  # the form that emcee requires
        state = module.State(np.asarray(post.starts(walkers, seed)), random_state=random)
        before = time.perf_counter()
        state = sampler.run_mcmc(state, n.warmup)
        sampler.reset()
        between = time.perf_counter()
        sampler.run_mcmc(state, n.draws // THIN, thin_by=THIN)
        after = time.perf_counter()
        cost = DENSITY * walkers
        return Run(
            np.swapaxes(sampler.get_chain(), 0, 1),
            (cost * n.warmup, cost * n.draws),
            (between - before, after - between),
        )

    return run


def _imported(name: str) -> Any:
    """Import a module that only this benchmark needs."""
    try:
        return __import__(name)
    except ImportError:
        sys.exit(f"{name} is not installed; pip install 'lcbayes[bench]'")


# name: function that compiles it for a posterior
SAMPLERS: dict[str, Callable[[Posterior, Length], Runner]] = {
    "AHMC exact": partial(numpyro_kernel, ahmc),
    "NUTS diagonal": partial(numpyro_kernel, partial(nuts, dense=False)),
    "NUTS dense": partial(numpyro_kernel, partial(nuts, dense=True)),
    "blackjax NUTS": blackjax_nuts,
    "emcee": emcee,
    "RMHMC": partial(numpyro_kernel, rmhmc),
}


def per_gradient(post: Posterior) -> float:
    """Time of one Fisher matrix over that of one gradient, each repeated in a compiled loop."""

    def many(f: Callable[..., Any]) -> Callable[..., jax.Array]:
        def body(y, args, shift):
            out = f(y + shift, *args)
            return y + 1e-12 * sum(jnp.sum(x) for x in jax.tree.leaves(out))

        return lambda y, args, shifts: jax.lax.scan(
            lambda y, shift: (body(y, args, shift), None), y, shifts
        )[0]

    took = []
    for f in (post.fisher, jax.value_and_grad(post.potential)):
        loop, inputs = jax.jit(many(f)), (jnp.zeros(post.dim), post.args, 1e-3 * jnp.ones(50))
        times = []
        for _ in range(6):  # the first compiles
            begun = time.perf_counter()
            jax.block_until_ready(loop(*inputs))
            times.append(time.perf_counter() - begun)
        took.append(np.median(times[1:]))
    return float(took[0] / took[1])
