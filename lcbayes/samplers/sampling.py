"""Parallel chains of one solution, run in blocks that are stored as checkpoints."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.checkpoint import Checkpoint
from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.progress import Track
from lcbayes.core.threads import threads
from lcbayes.modelling.constrained import potentials, quantities
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem, compiled
from lcbayes.samplers import chains, convergence
from lcbayes.samplers.facet_moves import FacetMoves
from lcbayes.samplers.settings import AUTO, FACET_MOVES, GUIDED, MAX_DRAWS, NUTS, Settings

Floats = NDArray[np.float64]
BLOCK = 50
OPTIMA = 8  # optima of a solution whose widths scale the coordinates
HALVINGS = 2  # maximum number of times that the step size of NUTS is halved
MAX_GUIDE_SD = 0.7  # nats: of ln of the density of a guide over the exact one, among its draws
EXACT = "-exact"  # of the name of chains whose guide was dropped
NUM_DRAWS = "num_draws"  # name in `Chains.tuning`


@dataclass
class Timing:
    """Run times of the phases of a run, and its number of gradients.

    The programs of the chains may be compiled while the search runs: the times then overlap.
    """

    search_s: float = 0.0
    compile_s: float = 0.0
    warmup_s: float = 0.0
    sampling_s: float = 0.0
    gradients: int = 0


class Chains(NamedTuple):
    """Chains about one solution.

    Attributes
    ----------
    z : (C, S, D)
    stats : statistics of each draw, (C, S) each
    whitening : Whitening
    tuning : length and results of the warm-up of each chain, (C, ...) each
        ``num_draws`` after the warm-up, kept or not, and ``step_size``; for NUTS
        ``inverse_mass_matrix`` (C, D, D) of z; for the kernels of this package also
        ``num_fallback``, the number of draws at which the metric was singular and a constant one
        was used; for AHMC also ``proposal_scale``, its δ.
    """

    z: Floats
    stats: dict[str, NDArray]
    whitening: chains.Whitening
    tuning: dict[str, NDArray]


class Negligible(Exception):
    """A solution holds less of the posterior than is asked for."""


class Sampler:
    """One compiled kernel for all solutions of a problem.

    Parameters
    ----------
    moves : FacetMoves, optional
        Moves of single facets, used unless the settings name another kernel.
    ordered : callable
        (z (n, D), reference (D,)) -> z with exchangeable facets in the order of the reference.
    guide : callable, optional
        Optimum (D,) -> epochs with which the density is cheaper, and similar about the optimum.
    """

    def __init__(
        self,
        problem: Problem,
        settings: Settings,
        workers: int,
        moves: FacetMoves | None = None,
        ordered: Callable[[Floats, Floats], Floats] = lambda z, reference: z,  # noqa: ARG005
        guide: Callable[[Floats], Epochs] | None = None,
    ) -> None:
        if settings.sampler == AUTO:
            alone = NUTS if guide is None else GUIDED
            settings = settings.with_sampler(alone if moves is None else FACET_MOVES)
        lacking = {FACET_MOVES: moves, GUIDED: guide}.get(settings.sampler, settings) is None
        if lacking:
            raise InputError(
                f"--sampler {settings.sampler} is made for other models; choose auto or nuts"
            )
        self.problem = problem
        self.settings = settings
        self.workers = workers
        self.ordered = ordered
        self.moves = moves if settings.sampler == FACET_MOVES else None
        self.guide = guide if settings.sampler == GUIDED else None

    @property
    def n_blocks(self) -> tuple[int, int]:
        """Numbers of blocks of warm-up and of sampling."""
        s = self.settings
        assert s.num_warmup is not None  # set by `Settings`
        return -(-s.num_warmup // BLOCK), -(-s.num_samples // BLOCK)

    @property
    def _pilot_blocks(self) -> int:
        """Blocks of warm-up of NUTS in the coordinates of the optimum; 0 for other kernels."""
        return self.n_blocks[0] // 3 if self.settings.sampler in (NUTS, GUIDED) else 0

    @property
    def _adapted(self) -> int:
        """Number of draws by which a kernel adapts its parameters."""
        return (self.n_blocks[0] - self._pilot_blocks) * BLOCK

    def prepare(self, data: Epochs, timing: Timing) -> None:
        """Compile the programs of the chains for data of this shape, before there is a start."""
        dim = self.problem.dim
        whitening, about = chains.Whitening(np.zeros(dim), np.eye(dim)), data
        if self.guide is not None:
            shapes = jax.eval_shape(self.guide, whitening.centre)
            about = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), shapes)
            for epochs in (data, about):
                compiled(self.problem.fisher)(whitening.centre, epochs)
        args = (whitening, data, *self._further(about))
        self._compile(jax.random.key(0), self._adapted, args, timing)

    def run(
        self,
        name: str,
        starts: Floats,
        data: Epochs,
        key: jax.Array,
        checkpoint: Checkpoint,
        timing: Timing,
        track: Track,
        least: float = -np.inf,
    ) -> Chains:
        """Draws about the solution of which ``starts`` (n, D) are optima, the best first.

        The chains begin at the optima in turn, so that R-hat tells whether they mix. After a part
        of its warm-up NUTS starts again, in coordinates that are whitened at the mean of the draws,
        since the widths at an optimum may not be those of the posterior.

        A guide is dropped, and the chains begin again without it, if it is too different from the
        posterior there.

        If `num_samples` draws do not suffice for convergence, the chains are extended, up to
        `most_samples`. If more NUTS transitions have diverged than all requested draws may contain,
        the draws are discarded and the chains continue with half the step size. The step size is
        not halved if the trajectories would then exceed the maximum tree depth.

        Raises
        ------
        Negligible
            After a part of the warm-up, ln of the evidence appears to be below ``least``.
        """
        about = data if self.guide is None else self.guide(starts[0])
        whitening = self._whitening(starts, about)
        args = (whitening, data, *self._further(about))
        warmup_blocks, sample_blocks = self.n_blocks
        per_block = self.settings.num_chains * BLOCK
        halvings = HALVINGS if self.settings.sampler in (NUTS, GUIDED) else 0
        start, advance = self._compile(key, self._adapted, args, timing)
        keys = jax.random.split(key, self.settings.num_chains)

        def chain(key, near):
            return _to_host(start(key, near, args))

        def block(state):
            return _to_host(advance(_to_device(state), args))

        with threads(self.workers) as pool:
            some = starts[: self.settings.num_chains]
            near = itertools.cycle([chains.Whitening.at(self.problem, z, about) for z in some])
            states = list(pool.map(chain, keys, near))
            blocks, first, end = [], warmup_blocks, warmup_blocks + sample_blocks
            while (i := len(blocks)) < end:
                if i == self._pilot_blocks > 0:
                    whitening, about = self._at_mean(blocks[-1], whitening, about, data)
                    if self.guide is not None and not self._similar(blocks[-1], about, data):
                        track.more(per_block * i)
                        rest = starts, data, key, checkpoint, timing, track, least
                        return self._without_guide().run(name + EXACT, *rest)
                    if _log_evidence(blocks[-1], whitening) < least:
                        track.more(-per_block * (end - i))
                        raise Negligible
                    args = (whitening, data, *self._further(about))
                    near = [chains.Whitening.point(z[-1]) for z in blocks[-1]["z"]]
                    keys = jax.vmap(jax.random.fold_in, (0, None))(keys, i)
                    states = list(pool.map(chain, keys, near))
                if (stored := checkpoint.load(f"{name}-{i:04d}")) is None:
                    stored = self._timed(pool.map(block, states), i < warmup_blocks, timing)
                    checkpoint.save(f"{name}-{i:04d}", stored)
                states = _unpack(stored, states)
                timing.gradients += int(stored["num_steps"].sum())
                blocks.append(stored)
                kept = blocks[first:]
                diverging = int(sum(b["diverging"].sum() for b in kept))
                track.advance(per_block, _said(stored, diverging))
                tolerable = convergence.MAX_DIVERGING * per_block * (end - first)
                if diverging > tolerable and halvings and _steps(kept) < 2**chains.DEPTH / 2:
                    states, halvings = [_finer(s) for s in states], halvings - 1
                    track.more(per_block * (len(blocks) - first))
                    first, end = len(blocks), len(blocks) + sample_blocks
                elif len(blocks) == end:
                    before, end = end, first + self._required_blocks(kept, starts[0], about)
                    track.more(per_block * (end - before))
        return self._collected(kept, states, whitening)

    def _without_guide(self) -> Sampler:
        """Chains along the exact density."""
        settings = self.settings.with_sampler(NUTS)
        return Sampler(self.problem, settings, self.workers, ordered=self.ordered)

    def _collected(
        self, blocks: list[dict[str, NDArray]], states: list, whitening: chains.Whitening
    ) -> Chains:
        """The draws of blocks, and the last states of their chains."""
        fields = ("z", *chains.FIELDS)
        whole = {k: np.concatenate([b[k] for b in blocks], axis=1) for k in fields}
        n = whole["z"].shape[1]
        kept = {k: v[:, self._kept(n)] for k, v in whole.items()}
        return Chains(kept.pop("z"), kept, whitening, self._tuning(states, whitening, n))

    @staticmethod
    def _timed(drawn: Iterable[Any], warmup: bool, timing: Timing) -> dict[str, np.ndarray]:
        """A block of all chains, as it is computed, packed."""
        begun = time.monotonic()
        block = _pack(list(drawn))
        took = time.monotonic() - begun
        if warmup:
            timing.warmup_s += took
        else:
            timing.sampling_s += took
        return block

    def _kept(self, n: int) -> slice:
        """The draws that are kept of n in each chain.

        Where more than `MAX_DRAWS` are needed, neighbours are so alike that few of them serve.
        """
        most = self.settings.most_samples
        extended = most > self.settings.num_samples
        every = -(-min(n, most) // MAX_DRAWS) if extended else 1
        return slice(every - 1, most, every)

    def _tuning(
        self, states: list, whitening: chains.Whitening, num_draws: int
    ) -> dict[str, NDArray]:
        """Length and what the warm-up of each chain adapted."""
        kernel = chains.kernel(self.problem, self.settings.sampler)
        each = [
            {NUM_DRAWS: num_draws} | chains.tuning(kernel, state, whitening) for state in states
        ]
        return {k: np.array([one[k] for one in each]) for k in each[0]}

    def _further(self, about: Epochs) -> tuple[FacetMoves | Epochs, ...]:
        """Arguments of the kernel besides the whitening and the data: the moves or the guide."""
        if self.moves is not None:
            return (self.moves,)
        return () if self.guide is None else (about,)

    def _whitening(self, starts: Floats, data: Epochs) -> chains.Whitening:
        if self.moves is None:
            return chains.Whitening.at(self.problem, starts[0], data)
        return chains.Whitening.along_axes(self.problem, starts[:OPTIMA], data)

    def _at_mean(
        self, block: dict[str, NDArray], whitening: chains.Whitening, about: Epochs, data: Epochs
    ) -> tuple[chains.Whitening, Epochs]:
        """The whitening and the epochs of the guide at the mean of the second half of a block.

        They stay as they are if the density at the mean is not above that of most draws: the mean
        of a curved posterior, or of one with several peaks, may be improbable.
        """
        late = slice(BLOCK // 2, None)
        mean = block["z"][:, late].mean(axis=(0, 1))
        typical = np.median(block["potential_energy"][:, late])
        if not float(compiled(self.problem.potential)(jnp.asarray(mean), about)) < typical:
            return whitening, about
        about = data if self.guide is None else self.guide(mean)
        return chains.Whitening.at(self.problem, mean, about), about

    def _similar(self, block: dict[str, NDArray], about: Epochs, data: Epochs) -> bool:
        """Whether the guide describes the posterior, judged by the second half of a block."""
        rows = block["z"][:, BLOCK // 2 :].reshape(-1, self.problem.dim)
        exact, guide = (potentials(self.problem, rows, x) for x in (data, about))
        return bool(np.std(exact - guide) < MAX_GUIDE_SD)

    def _in_order(self, draws: Floats, reference: Floats) -> Floats:
        """Draws (C, S, D) with exchangeable facets in the order of the reference (D,)."""
        return self.ordered(draws.reshape(-1, draws.shape[2]), reference).reshape(draws.shape)

    def _required_blocks(
        self, kept: list[dict[str, NDArray]], reference: Floats, data: Epochs
    ) -> int:
        draws = np.concatenate([b["z"] for b in kept], axis=1)
        return -(-self._required_length(self._in_order(draws, reference), data) // BLOCK)

    def _required_length(self, z: Floats, data: Epochs) -> int:
        """Length at which z (C, S, D) and the quantities that a result reports converge.

        Chains may agree about coordinates and disagree about what is computed from them. The length
        of a vector that represents a direction varies more than its direction, for example.
        """
        longest = self.settings.most_samples
        shown = quantities(self.problem, z, data)
        return max(
            convergence.required_length(z, longest),
            convergence.required_length(shown, longest, margin=1.0),
        )

    def _compile(self, key: jax.Array, num_warmup: int, args: tuple, timing: Timing):
        begun = time.monotonic()
        shapes = jax.tree.map(lambda x: jax.ShapeDtypeStruct(x.shape, x.dtype), (key, args))
        leaves, structure = jax.tree.flatten(shapes)
        sampler = self.settings.sampler
        program = programs(self.problem, sampler, num_warmup, structure, tuple(leaves))
        timing.compile_s += time.monotonic() - begun
        return program


def _said(block: dict[str, NDArray], diverging: int) -> str:
    return f"{_steps([block]):.0f} steps/draw, {diverging} divergent"


def _steps(blocks: list[dict[str, NDArray]]) -> float:
    return float(np.mean([b["num_steps"].mean() for b in blocks]))


def _log_evidence(block: dict[str, NDArray], whitening: chains.Whitening) -> float:
    """ln Z from the second half of a block, −⟨U⟩ + D/2 (1 + ln 2π) + ln |factor|.

    This is the mean ln density and the entropy of a Gaussian of the widths of the whitening.
    Chains that still leave the optimum have a lower energy, so that Z is then too large.
    """
    energy = float(block["potential_energy"][:, BLOCK // 2 :].mean())
    log_det = float(np.linalg.slogdet(whitening.factor)[1])
    return -energy + 0.5 * len(whitening.centre) * (1 + np.log(2 * np.pi)) + log_det


def _finer(state):
    """A state of NUTS with half the step size, which is not adapted after the warm-up."""
    adapted = state.adapt_state
    return state._replace(adapt_state=adapted._replace(step_size=0.5 * adapted.step_size))


@lru_cache(maxsize=16)
def programs(problem: Problem, sampler: str, num_warmup: int, structure, leaves: tuple) -> tuple:
    """Compiled programs of a chain, its start and a block of draws, for given argument shapes.

    All light curves of the problem share them.
    """
    kernel = chains.kernel(problem, sampler)
    key, args = jax.tree.unflatten(structure, leaves)
    near = args[0]
    first = chains.start.lower(kernel, key, num_warmup, near, args).compile()
    state = jax.eval_shape(
        lambda k, n, a: chains.start(kernel, k, num_warmup, n, a), key, near, args
    )
    step = chains.advance.lower(kernel, BLOCK, state, args).compile()
    return first, step


def _is_key(x) -> bool:
    return jnp.issubdtype(x.dtype, jax.dtypes.prng_key)


def _to_host(tree):
    """The same tree with NumPy leaves, which can be stored in a checkpoint."""
    return jax.tree.map(
        lambda x: _Key(np.asarray(jax.random.key_data(x))) if _is_key(x) else np.asarray(x), tree
    )


def _to_device(tree):
    return jax.tree.map(
        lambda x: jax.random.wrap_key_data(jnp.asarray(x.data)) if isinstance(x, _Key) else x,
        tree,
        is_leaf=lambda x: isinstance(x, _Key),
    )


class _Key:
    """A random key as plain integers."""

    def __init__(self, data: np.ndarray) -> None:
        self.data = data


def _leaves(state):
    return jax.tree.flatten(state, is_leaf=lambda x: isinstance(x, _Key))


def _pack(out: list) -> dict[str, np.ndarray]:
    """Draws, statistics and states of all chains after a block, as a dict of arrays."""
    packed = {"z": np.stack([z for _, z, _ in out])}
    packed |= {k: np.stack([stats[k] for *_, stats in out]) for k in chains.FIELDS}
    for c, (state, _, _) in enumerate(out):
        for i, leaf in enumerate(_leaves(state)[0]):
            packed[f"state-{c}-{i}"] = leaf.data if isinstance(leaf, _Key) else leaf
    return packed


def _unpack(packed: dict[str, np.ndarray], like: list) -> list:
    states = []
    for c, state in enumerate(like):
        old, tree = _leaves(state)
        new = [
            _Key(packed[f"state-{c}-{i}"]) if isinstance(leaf, _Key) else packed[f"state-{c}-{i}"]
            for i, leaf in enumerate(old)
        ]
        states.append(jax.tree.unflatten(tree, new))
    return states
