"""The plane of the sky at an object: axes to the west and to the north of the equator of J2000."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lcbayes.core.constants import OBLIQUITY

Floats = NDArray[np.float64]

EQUATOR_NORTH = np.array([0.0, np.sin(OBLIQUITY), np.cos(OBLIQUITY)])  # ecliptic J2000


def west_north(to_observer: ArrayLike) -> Floats:
    """Unit vectors to the west and to the north in the plane of the sky, ecliptic J2000.

    With z the direction from the object to the observer, x = N × z / |N × z| and y = z × x, where
    N is the north pole of the equator of J2000. Seen from the observer, x points right and y up.

    Parameters
    ----------
    to_observer : (3,)
        Vector from the object to the observer, ecliptic J2000, of any length.

    Returns
    -------
    (2, 3)
        Rows x and y.

    Examples
    --------
    >>> west_north([-1.0, 0.0, 0.0])[0].round(3)
    array([ 0.   , -0.917,  0.398])
    """
    z = np.asarray(to_observer, float) / np.linalg.norm(to_observer)
    x = np.cross(EQUATOR_NORTH, z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x)])
