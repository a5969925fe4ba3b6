"""The attitude of the body in time, by which two solutions have the same motion or not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.jax_setup import jnp
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import OBS, SUN, Problem, compiled

Floats = NDArray[np.float64]

SAME_ATTITUDE = 0.6  # rad


def motion(problem: Problem, data: Epochs, z: Floats) -> Floats:
    """`attitudes` at as many epochs as the data have, evenly over their time span.

    Between passes, too: motions that differ by a turn there have the same attitudes in all passes.
    """
    t = np.asarray(data.t)
    evenly = jnp.linspace(t.min(), t.max(), t.size)
    return attitudes(problem, replace(data, t=evenly), z)


def attitudes(problem: Problem, data: Epochs, z: Floats) -> Floats:
    """Matrices (T, 3, 3) that take inertial vectors to body axes at the epochs of the data.

    The model is evaluated with the inertial axes x and y in place of the directions to Sun and
    observer, so that any motion that it knows will do.

    Parameters
    ----------
    problem : Problem
        With the sites `SUN` and `OBS`.
    data : Epochs
    z : (D,)
    """
    x, y = (jnp.broadcast_to(jnp.asarray(axis), data.sun.shape) for axis in np.eye(3)[:2])
    sites = compiled(problem.constrain)(jnp.asarray(z), replace(data, sun=x, obs=y))
    first, second = (np.asarray(sites[name]) for name in (SUN, OBS))
    return np.stack([first, second, np.cross(first, second)], axis=2)


def same_motion(a: Floats, b: Floats) -> bool:
    """Whether two motions (T, 3, 3) differ by a constant choice of body axes only.

    The angle by which the second is turned from the first, in its own body axes, must stay within
    `SAME_ATTITUDE` of its mean. Constant rates may therefore differ by twice that angle over the
    time base.
    """
    turn = np.einsum("tij,tkj->tik", b, a)
    u, _, v = np.linalg.svd(turn.mean(axis=0))
    mean = u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v
    cosine = 0.5 * (np.einsum("tij,ij->t", turn, mean).min() - 1.0)
    return bool(cosine > np.cos(SAME_ATTITUDE))
