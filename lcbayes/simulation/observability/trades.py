"""Combinations of parameters that a campaign does not constrain, with descriptions in words.

Parameters are in units of their prior widths, so that the eigenvalues λ of the information are
comparable: λ is the information of the measurements on a combination relative to that of the prior.
A combination with λ < 1 is called open. Open combinations span a space whose basis is arbitrary.
The basis shown is made sparse by rotation (varimax). Two kinds of combinations are separated first:
parameters without influence on any measurement, and the choice of body axes. Unobservable and
weakly constrained combinations are rotated separately.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.text import join_words
from lcbayes.simulation.observability.campaign import NOTHING, Campaign
from lcbayes.simulation.observability.measurements import Measurements, by_facet
from lcbayes.simulation.observability.parameters import Parameter, Unknowns

Floats = NDArray[np.float64]

MIN_INFORMATION_GAIN = 1.0  # relative to the prior; a combination with less is open
MIN_SHOWN_SHARE = 0.15  # of the largest part of a combination; smaller parts are not named
MAX_PATH_WIDTH = 0.5  # over length, for a path of the half vector with a well-defined direction


@dataclass(frozen=True)
class Trade:
    """A combination of parameters that the measurements do not constrain.

    Attributes
    ----------
    words : one sentence
    combination : (P,)
        Unobserved change of each parameter, in the unit of that parameter; its total length is one
        prior width.
    information : λ, information of the measurements relative to that of the prior
    exact : whether all measurements are independent of it, to first order
    """

    words: str
    combination: Floats
    information: float
    exact: bool


def trades(campaign: Campaign, measured: Measurements) -> list[Trade]:
    """Open combinations: first those without any influence, then by increasing information."""
    unknowns = campaign.unknowns
    sd = unknowns.prior_sd
    scaled = campaign.jacobian * sd
    _, values, rows = np.linalg.svd(scaled, full_matrices=True)
    information = np.zeros(len(sd))
    information[: len(values)] = values**2
    floor = NOTHING * max(information[0], MIN_INFORMATION_GAIN)
    still = np.flatnonzero(np.sum(scaled**2, axis=0) <= floor)
    named = [*_dark(unknowns, still)]
    basis = [np.eye(len(sd))[still]]
    axes = _body_axes(unknowns)
    if axes is not None:
        words = "the attitude and all normals together trade: the choice of body axes"
        named += [
            Trade(f"{words}, {axis}", sd * row, 0.0, True)
            for axis, row in zip("xyz", axes, strict=True)
        ]
        basis.append(axes)
    known, _ = np.linalg.qr(np.concatenate(basis).T) if any(map(len, basis)) else (None, None)
    paths = _paths(unknowns, measured)
    other = []
    for exact in (True, False):
        # separates unobservable from weakly constrained combinations
        rest = rows[(information < MIN_INFORMATION_GAIN) & ((information <= floor) == exact)]
        if known is not None:
            rest = rest - rest @ known @ known.T
        _, size, rest = np.linalg.svd(rest, full_matrices=False)
        for v in varimax(rest[size > 0.5].T).T:
            gained = float(np.sum((scaled @ v) ** 2))
            v = v * np.sign(v[np.argmax(np.abs(v))])
            other.append(Trade(_sentence(unknowns, v, gained, exact, paths), sd * v, gained, exact))
    return named + sorted(other, key=lambda trade: trade.information)


def varimax(loadings: Floats, rounds: int = 200) -> Floats:
    """Orthogonal rotation of columns (P, k) to sparse columns, with maximum variance of squares.

    References
    ----------
    Kaiser 1958, Psychometrika 23, 187; the iteration by singular values of Horst 1965.
    """
    if loadings.shape[1] < 2:
        return loadings
    rotation, last = np.eye(loadings.shape[1]), 0.0
    for _ in range(rounds):
        now = loadings @ rotation
        slope = loadings.T @ (now**3 - now * np.mean(now**2, axis=0))
        left, size, right = np.linalg.svd(slope)
        rotation = left @ right
        if size.sum() < last * (1.0 + 1e-10):
            break
        last = size.sum()
    return loadings @ rotation


def _dark(unknowns: Unknowns, still: NDArray[np.intp]) -> list[Trade]:
    """One trade for each parameter without influence; those of one facet share a sentence."""
    made = []
    for i in still:
        p = unknowns.parameters[i]
        change = np.zeros(len(unknowns.parameters))
        change[i] = p.prior_sd
        whole = {
            j
            for j, q in enumerate(unknowns.parameters)
            if q.facet == p.facet and q.facet is not None
        }
        if p.facet is not None and whole <= set(still.tolist()):
            words = f"facet {p.facet} is never lit and seen: nothing is learnt of its {_short(p)}"
        else:
            words = f"no measurement depends on the {p.words}"
        made.append(Trade(words, change, 0.0, True))
    return made


def _short(p: Parameter) -> str:
    return "area" if p.group == "areas" else p.words.replace(f" of facet {p.facet}", "")


def _body_axes(unknowns: Unknowns) -> Floats | None:
    """Rotations of the attitude by −ε and of every facet by ε: three scaled unit vectors, or None.

    The flux depends only on dot products of body vectors exp([δα×]) s with normals R(w) n, so that
    w = δα for every facet leaves it unchanged.
    """
    names = unknowns.names
    if "attitude_x" not in names or not len(unknowns.rows("normals")):
        return None
    body = unknowns.scenario.body
    vectors = np.zeros((3, len(names)))
    v_axes = np.cross(body.normals, body.u_axes)
    for i, p in enumerate(unknowns.parameters):
        if p.group == "attitude":
            vectors["xyz".index(p.name[-1]), i] = 1.0
        elif p.group == "normals":
            # w = e: towards u by e·(n × u) = e·v, towards v by −e·u, about n by e·n
            along = {"u": v_axes, "v": -body.u_axes, "n": body.normals}[p.name[-1]]
            vectors[:, i] = along[p.facet]
    vectors = vectors / unknowns.prior_sd
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def _paths(unknowns: Unknowns, measured: Measurements) -> dict[int, Floats]:
    """Body-frame direction of the half vector's path over each facet, if it is well defined.

    It is the principal axis of the half vectors projected on the plane of the facet, weighted by
    the flux of the facet.
    """
    body = unknowns.scenario.body
    reflected = by_facet(unknowns.scenario, measured.sun_body, measured.obs_body)
    half = measured.sun_body + measured.obs_body
    half = half / np.maximum(np.linalg.norm(half, axis=1, keepdims=True), 1e-12)
    paths = {}
    for i, (n, u) in enumerate(zip(body.normals, body.u_axes, strict=True)):
        weight = reflected[:, i]
        if weight.sum() <= 0.0:
            continue
        plane = np.stack([u, np.cross(n, u)])
        values, vectors = np.linalg.eigh(np.cov(plane @ half.T, aweights=weight, ddof=0))
        if values[1] > 0.0 and np.sqrt(max(values[0], 0.0) / values[1]) < MAX_PATH_WIDTH:
            paths[i] = vectors[:, 1] @ plane
    return paths


def _sentence(
    unknowns: Unknowns, v: Floats, gained: float, exact: bool, paths: dict[int, Floats]
) -> str:
    parts = _parts(unknowns, v, paths)
    top = parts[0].size
    kept = [p for p in parts if p.size >= MIN_SHOWN_SHARE * top][:6]
    how = (
        "not seen at all"
        if exact
        else f"known to {100 / np.sqrt(1 + gained):.0f} % of the prior sd"
    )
    if len(kept) == 1:
        return f"the {kept[0].words} {'are' if kept[0].plural else 'is'} open: {how}"
    alone = {p.facet for p in kept}
    if len(kept) == 2 and len(alone) == 1 and kept[0].facet is not None:
        area = next((p for p in kept if p.kind == "area"), None)
        tilt = next((p for p in kept if p.kind == "tilt"), None)
        if area and tilt:
            degrees = np.degrees(tilt.amount / abs(area.amount) * np.log(1.1))
            return (
                f"{area.noun} and tilt of facet {area.facet} trade {tilt.where}: 10 % of area "
                f"for {degrees:.2g} deg; {how}"
            )
    kinds = {p.kind for p in kept}
    if kinds <= {"area", "tilt"} and len(alone) > 1 and _alike(unknowns, sorted(alone)):  # pyright: ignore[reportArgumentType]
        apart = "how one is tilted against the other"
        what = "how their area is shared out" if kinds == {"area"} else apart
        listed = join_words([str(f) for f in sorted(alone)])  # pyright: ignore[reportArgumentType]
        return f"facets {listed} face the same way, and {what} is {how}"
    if len(kinds) == 1 and kept[0].kind in ("area", "tilt") and len(alone) == len(kept):
        listed = join_words(sorted((str(p.facet) for p in kept), key=int))
        noun = f"{kept[0].noun}s" if kept[0].kind == "area" else "tilts"
        return f"the {noun} of facets {listed} trade against each other: {how}"
    return f"the {join_words([p.words for p in kept])} trade: {how}"


def _alike(unknowns: Unknowns, facets: list[int]) -> bool:
    """Whether facets have the same normal."""
    normals = unknowns.scenario.body.normals[facets]
    return bool(np.all(normals @ normals[0] > 1.0 - 1e-9))


@dataclass(frozen=True)
class _Part:
    kind: str
    words: str
    size: float  # in prior widths
    amount: float  # in the unit of the parameter
    facet: int | None = None
    noun: str = ""
    where: str = ""
    plural: bool = False


def _parts(unknowns: Unknowns, v: Floats, paths: dict[int, Floats]) -> list[_Part]:
    """The parts of a combination: tilts, areas and other parameters, largest first."""
    body, parts = unknowns.scenario.body, []
    tilts: dict[int, Floats] = {}
    spin = np.zeros(3)
    for p, c in zip(unknowns.parameters, v, strict=True):
        if p.group == "normals" and p.name[-1] in "uv":
            u = body.u_axes[p.facet]
            axis = u if p.name[-1] == "u" else np.cross(body.normals[p.facet], u)
            tilts[p.facet] = tilts.get(p.facet, np.zeros(3)) + c * axis  # pyright: ignore[reportArgumentType, reportCallIssue]
        elif p.name.startswith("omega_"):
            spin["xyz".index(p.name[-1])] = c
        else:
            kind = "area" if p.group == "areas" else "other"
            noun = p.words.split(" of ")[0]
            parts.append(_Part(kind, p.words, abs(c), c * p.prior_sd, p.facet, noun))
    for facet, d in tilts.items():
        size = float(np.linalg.norm(d))
        if size > 0.0:
            sd = next(
                p.prior_sd for p in unknowns.parameters if p.group == "normals" and p.facet == facet
            )
            where = _direction(d / size, paths.get(facet))
            parts.append(
                _Part(
                    "tilt", f"tilt of facet {facet} {where}", size, size * sd, facet, "tilt", where
                )
            )
    if np.any(spin):
        size = float(np.linalg.norm(spin))
        axis = ", ".join(f"{x:.2g}" for x in spin / size)
        parts.append(_Part("spin", f"part of ω along ({axis})", size, size))
    return sorted(parts, key=lambda part: -part.size)


def _direction(d: Floats, path: Floats | None) -> str:
    """Direction of a tilt relative to the path of the half vector over the facet."""
    if path is None:
        return "in one direction"
    angle = float(np.degrees(np.arccos(min(1.0, abs(float(d @ path))))))
    if angle < 30.0:
        return "along the pass direction"
    if angle > 60.0:
        return "across the pass direction"
    return f"at {angle:.0f} deg to the pass direction"
