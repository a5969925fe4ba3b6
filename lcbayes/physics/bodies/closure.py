"""Closure of facets to a surface, and the nearest areas that close."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lcbayes.core.errors import InputError

Floats = NDArray[np.float64]
MAX_STEPS = 100


def closure(normals: ArrayLike, areas: ArrayLike) -> float:
    """|Σ A n| / Σ A: zero for a closed surface.

    Parameters
    ----------
    normals : (N, 3)
        Outward unit normals.
    areas : (N,)
    """
    a = np.asarray(areas, float)
    return float(np.linalg.norm(a @ np.asarray(normals, float)) / a.sum())


def close(normals: ArrayLike, areas: ArrayLike) -> Floats:
    """The areas a ≥ 0 of a closed surface, Σ aᵢ nᵢ = 0, that are nearest to the given areas.

    They minimise Σ (aᵢ − Aᵢ)²/Aᵢ: a large facet may change more than a small one, and a facet with
    zero area remains so. The solution is aᵢ = Aᵢ max(0, 1 − λ·nᵢ), where λ minimises the convex
    function ½ Σ Aᵢ max(0, 1 − λ·nᵢ)² of three variables, computed with Newton's method.

    Parameters
    ----------
    normals : (N, 3)
        Outward unit normals.
    areas : (N,)
        Not negative.

    Returns
    -------
    (N,)
        Closed to rounding. Σ |a − A| / Σ A measures the change.

    Raises
    ------
    InputError
        If all facets face one side, so that only zero areas would close.
    """
    n, given = np.asarray(normals, float), np.asarray(areas, float)
    share = given / given.sum()
    shift = np.zeros(3)

    def of(shift: Floats) -> tuple[Floats, float]:
        left = np.maximum(0.0, 1.0 - n @ shift)
        return left, 0.5 * float(share @ left**2)

    left, value = of(shift)
    for _ in range(MAX_STEPS):
        gap = (share * left) @ n
        if np.linalg.norm(gap) < 1e-16:
            break
        tensor = np.einsum("n,ni,nj->ij", share * (left > 0), n, n)
        step = np.linalg.lstsq(tensor, gap, rcond=1e-14)[0]
        size = 1.0
        while size > 1e-12:
            left, new = of(shift + size * step)
            if new <= value - 1e-4 * size * float(gap @ step):
                break
            size *= 0.5
        else:  # no improvement beyond rounding
            left, _ = of(shift)
            break
        shift, value = shift + size * step, new
    closed = share * left
    if not np.linalg.norm(closed @ n) <= 1e-9 * closed.sum() or closed.sum() < 1e-3:
        raise InputError(
            f"facets do not close: |sum(A n)| / sum(A) = {closure(n, given):.2g}, and they all "
            "face to one side, so no change of their areas closes them"
        )
    return closed * given.sum()
