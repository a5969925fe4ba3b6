"""Facets of a satellite of known attitude, parsed from user input."""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np

from lcbayes.core.errors import InputError

ARRAY = "array"
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?"
_FACET = re.compile(
    rf"(?:(?P<where>[a-z][a-z-]*):)?\s*(?:(?P<axis>[+-][xyz])|(?P<vector>{_NUMBER}(?:\s+{_NUMBER}){{2}}))"
    rf"\s*(?:~\s*(?P<sd>{_NUMBER}))?\s*(?:@\s*(?P<area>{_NUMBER}))?",
    re.IGNORECASE,
)
EXPECTED = "+z, array:+x~5, 0 0.6 0.8@3.6 (law: direction ~ degrees @ m²)"


class Facet(NamedTuple):
    """Prior information on a facet.

    Attributes
    ----------
    where : str
        Axes of the normal: "" for the body, "array" for its solar array, otherwise the name of an
        attitude law.
    normal : 3 floats
        Unit vector; for an uncertain normal, its mean direction.
    sd_deg : float
        Standard deviation of its tilt about each of two axes; 0 for a known normal.
    area_m2 : float or None
    """

    where: str
    normal: tuple[float, float, float]
    sd_deg: float = 0.0
    area_m2: float | None = None


def facet_list(text: str) -> list[Facet]:
    """The facets of a list such as "+z, array:+x~5, 0 0.6 0.8@3.6".

    Entries are separated by commas. Each is a direction in the axes of the body, or in those of its
    array or of another law, whose name and a colon then precede the direction. The uncertainty in
    degrees (after ~) and the area in m² (after @) are optional.

    Raises
    ------
    InputError
        If an entry is invalid; the message names it.
    """
    facets = []
    for entry in filter(None, (part.strip() for part in text.split(","))):
        match = _FACET.fullmatch(entry)
        if match is None:
            raise InputError(f"facets: {entry!r} is none; expected something like {EXPECTED}")
        if match["axis"]:
            normal = np.eye(3)["xyz".index(match["axis"][1].lower())]
            normal = -normal if match["axis"][0] == "-" else normal
        else:
            normal = np.array([float(x) for x in match["vector"].split()])
        length = np.linalg.norm(normal)
        sd = float(match["sd"] or 0.0)
        area = None if match["area"] is None else float(match["area"])
        if not length > 0:
            raise InputError(f"facets: {entry!r} points nowhere; give a direction that is not zero")
        if not 0 <= sd <= 60:
            raise InputError(
                f"facets: {entry!r} is uncertain by {sd:g} degrees; give 0 to 60, or leave the "
                "facet out of the list and raise n_facets: those not listed point anywhere"
            )
        if area is not None and not area > 0:
            raise InputError(f"facets: {entry!r} has an area of {area:g} m²; give one > 0")
        x, y, z = (normal / length).tolist()
        facets.append(Facet((match["where"] or "").lower(), (x, y, z), sd, area))
    return facets
