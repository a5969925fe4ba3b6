"""Levenberg-Marquardt minimisation of an objective with a positive semi-definite curvature."""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from lcbayes.core.jax_setup import jax, jnp

SMALLEST_DAMPING = 1e-9  # keeps the equations regular where parameters are degenerate
LARGEST_DECREASE = 0.1  # smallest factor of the damping in one step, with Nielsen's rule


class Quadratic(NamedTuple):
    """The objective and its local quadratic model.

    Attributes
    ----------
    value : scalar
        The objective f. A step to a value that is not finite is rejected.
    gradient : (D,)
        ∇f.
    curvature : (D, D)
        Approximation of the Hessian that is positive semi-definite: JᵀJ for half a sum of squares
        with the Jacobian J (Gauss-Newton), or the Fisher information (Fisher scoring).
    aux : pytree
        Further results at this point, kept for the final one.
    """

    value: Any
    gradient: Any
    curvature: Any
    aux: Any = None


class Controls(NamedTuple):
    """How the damping changes, and when a minimisation ends.

    Attributes
    ----------
    decrease : float or None
        Divisor of the damping after an accepted step. None: Nielsen's rule, by the ratio of actual
        to predicted gain, with which fewer steps are rejected.
    increase : float
        Factor of the damping after a rejected step. With Nielsen's rule it doubles at each further
        rejection in succession.
    largest_damping : float
        A minimisation ends above this damping: no step reduces the objective.
    patience : int
        A minimisation ends after this number of accepted steps in succession with a gain below the
        tolerance.
    """

    decrease: float | None = 5.0
    increase: float = 4.0
    largest_damping: float = 1e8
    patience: int = 3


NIELSEN = Controls(decrease=None, increase=2.0)


class Minimum(NamedTuple):
    """The end of a minimisation.

    Attributes
    ----------
    position : the best position, of the type of the start
    model : `Quadratic` at the position; its value is infinite if it is not finite at the start
    damping : the last damping
    increase : factor of the damping at the next rejection
    stalled : number of successive accepted steps with a gain below the tolerance
    steps : number of steps, rejected ones included
    """

    position: Any
    model: Quadratic
    damping: Any
    increase: Any
    stalled: Any
    steps: Any


def levenberg_marquardt(
    model_fn: Callable[[Any], Quadratic],
    start: Any,
    *,
    num_steps: Any,
    tolerance: Any,
    damping: Any = 1e-2,
    stalled: Any = 0,
    controls: Controls = Controls(),  # noqa: B008 - immutable
    move: Callable[[Any, Any], Any] = operator.add,
) -> Minimum:
    """Minimise an objective by damped Gauss-Newton steps.

    The step solves (C + λ D) δ = −g with the curvature C, its diagonal D and the gradient g
    (Marquardt's scaling). A step that reduces the objective is accepted and lowers λ; any other
    step raises it. Each step evaluates the objective once.

    Starts of JAX arrays run in a compiled loop: call the function within `jax.jit`, and batch it
    with `jax.vmap` or `jax.lax.map`. Starts of NumPy arrays run in a Python loop, for objectives
    whose number of parameters changes from call to call.

    Parameters
    ----------
    model_fn : callable
        Position → `Quadratic`. `of_residuals` makes it from residuals.
    start : pytree
        The first position.
    num_steps : int
        Maximum number of steps; may be traced.
    tolerance : float
        Gain, in units of the objective, below which ``controls.patience`` accepted steps in
        succession end the minimisation; may be traced.
    damping : float
        The first λ, relative to the diagonal of the curvature; may be traced.
    stalled : int
        Number of steps below the tolerance that precede the start. If it reaches
        ``controls.patience``, the start is only evaluated.
    controls : Controls
    move : callable
        (position, step (D,)) → position. Default: their sum.

    Returns
    -------
    Minimum

    References
    ----------
    Marquardt 1963, SIAM J. Appl. Math. 11, 431. Nielsen 1999, IMM-REP-1999-05 (his rule for the
    damping). Madsen, Nielsen & Tingleff 2004, *Methods for non-linear least squares problems*,
    sec. 3.2.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.linspace(0.0, 2.0, 9)
    >>> def model(p):
    ...     decay = np.exp(-p[1] * t)
    ...     residual = p[0] * decay - 3.0 * np.exp(-0.7 * t)
    ...     jacobian = np.stack([decay, -p[0] * t * decay], axis=1)
    ...     return gauss_newton(residual, jacobian)
    >>> end = levenberg_marquardt(model, np.ones(2), num_steps=50, tolerance=1e-20)
    >>> end.position.round(6).tolist()
    [3.0, 0.7]
    """
    if all(isinstance(leaf, np.ndarray) for leaf in jax.tree.leaves(start)):
        state = Minimum(start, model_fn(start), damping, controls.increase, stalled, 0)
        while _continues(state, num_steps, controls):
            state = _stepped(np, _chosen, model_fn, move, state, tolerance, controls)
        return state
    traced = jax.jit(model_fn)  # one trace for the shapes and for the loop
    shapes = jax.eval_shape(traced, start)
    empty = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), shapes)
    # The step from an empty model is zero, so that the first iteration evaluates the start. The
    # program then contains the objective once.
    state = Minimum(
        start,
        empty._replace(value=jnp.full_like(empty.value, jnp.inf)),
        jnp.asarray(damping, float),
        jnp.asarray(controls.increase, float),
        jnp.asarray(stalled, int),
        jnp.asarray(-1, int),
    )
    return jax.lax.while_loop(
        lambda s: (s.steps < 0) | _continues(s, num_steps, controls),
        lambda s: _stepped(jnp, _selected, traced, move, s, tolerance, controls),
        state,
    )


def gauss_newton(residual: Any, jacobian: Any, aux: Any = None) -> Quadratic:
    """The model of ½ Σ r² from residuals r (T,) and their Jacobian (T, D)."""
    return Quadratic(0.5 * (residual @ residual), jacobian.T @ residual, jacobian.T @ jacobian, aux)


def of_residuals(residual_fn: Callable[..., jax.Array], *args: Any) -> Callable[..., Quadratic]:
    """``model_fn`` of ½ Σ r² for JAX residuals r(position, *args), (T,), of a position (D,)."""

    def model(position: jax.Array) -> Quadratic:
        residual = residual_fn(position, *args)
        return gauss_newton(residual, jax.jacfwd(residual_fn)(position, *args))

    return model


def _continues(state: Minimum, num_steps: Any, controls: Controls) -> Any:
    return (
        (state.steps < num_steps)
        & (state.stalled < controls.patience)
        & (state.damping <= controls.largest_damping)
    )


def _stepped(
    xp: Any,
    select: Callable[[Any, Any, Any], Any],
    model_fn: Callable[[Any], Quadratic],
    move: Callable[[Any, Any], Any],
    state: Minimum,
    tolerance: Any,
    controls: Controls,
) -> Minimum:
    """One step, with NumPy or JAX as ``xp``."""
    step, predicted = _solved(xp, state.model, state.damping)
    trial = move(state.position, step)
    new = model_fn(trial)
    first = state.steps < 0
    better = xp.isfinite(new.value) & (new.value < state.model.value)
    gain = xp.where(better, state.model.value - new.value, 0.0)
    position, model = select(better, (trial, new), (state.position, state.model))
    if controls.decrease is None:
        ratio = gain / xp.maximum(predicted, 1e-300)
        less = xp.maximum(LARGEST_DECREASE, 1.0 - (2.0 * ratio - 1.0) ** 3)
        increase = xp.where(better, controls.increase, 2.0 * state.increase)
    else:
        less, increase = 1.0 / controls.decrease, state.increase
    damping = state.damping * xp.where(better, less, state.increase)
    small = xp.where(gain < tolerance, state.stalled + 1, 0)
    return Minimum(
        position,
        model,
        xp.where(first, state.damping, xp.maximum(damping, SMALLEST_DAMPING)),
        xp.where(first, state.increase, increase),
        xp.where(better & xp.logical_not(first), small, state.stalled),
        state.steps + 1,
    )


def _solved(xp: Any, model: Quadratic, damping: Any) -> tuple[Any, Any]:
    """The step, and the gain that the quadratic model predicts for it.

    Parameters are scaled to a unit diagonal of the curvature. Those without effect do not move.
    """
    own = xp.diagonal(model.curvature)
    size = xp.sqrt(xp.maximum(own, xp.maximum(1e-12 * own.mean(), 1e-300)))
    scaled = model.curvature / size / size[:, None]
    step = -xp.linalg.solve(scaled + damping * xp.eye(len(size)), model.gradient / size) / size
    return step, -(model.gradient @ step) - 0.5 * (step @ model.curvature @ step)


def _chosen(better: Any, new: Any, old: Any) -> Any:
    return new if better else old


def _selected(better: Any, new: Any, old: Any) -> Any:
    return jax.tree.map(lambda a, b: jnp.where(better, a, b), new, old)
