"""Equal cells of the sphere, each divided into four: the nested scheme of HEALPix."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.integer]

_RING = np.repeat([2, 3, 4], 4)  # of the lowest corner of each of the twelve base cells
_COLUMN = np.array([1, 3, 5, 7, 0, 2, 4, 6, 1, 3, 5, 7])


def number(level: int) -> int:
    """Number of cells at a level of division; the first level, 0, has twelve."""
    return 12 * 4**level


def centres(cells: Integers, level: Integers | int) -> Floats:
    """Unit vectors (N, 3) to the centres of cells.

    The four parts of cell k are the cells 4k to 4k + 3 of the next level.

    Parameters
    ----------
    cells : (N,)
        Numbers of the cells at their levels.
    level : (N,) or int

    References
    ----------
    Górski et al. 2005, ApJ 622, 759, sec. 4.1.

    Examples
    --------
    >>> from lcbayes.inversion.attitude_scan.sphere_cells import centres, number
    >>> import numpy as np
    >>> bool(np.allclose(centres(np.arange(number(2)), 2).mean(axis=0), 0.0))
    True
    """
    cells = np.asarray(cells, np.int64)
    side = 2 ** np.broadcast_to(np.asarray(level, np.int64), cells.shape)
    face, within = np.divmod(cells, side * side)
    x, y = _even_bits(within), _even_bits(within >> 1)
    ring = _RING[face] * side - x - y - 1  # counted from the north
    north, south = ring < side, ring > 3 * side
    count = np.where(north, ring, np.where(south, 4 * side - ring, side))  # a quarter of the ring
    cap = count**2 / (3.0 * side**2)
    belt = 2.0 * (2 * side - ring) / (3.0 * side)
    z = np.where(north, 1.0 - cap, np.where(south, cap - 1.0, belt))
    shift = np.where(north | south, 0, (ring - side) & 1)
    column = (_COLUMN[face] * count + x - y + 1 + shift) // 2
    lon = (column - 0.5 * (shift + 1)) * (0.5 * np.pi / count)
    flat = np.sqrt(1.0 - z * z)
    return np.stack([flat * np.cos(lon), flat * np.sin(lon), z], axis=1)


def _even_bits(number: Integers) -> Integers:
    """Every second bit of each number, from the lowest."""
    out = np.zeros_like(number)
    for bit in range(16):
        out |= ((number >> (2 * bit)) & 1) << bit
    return out
