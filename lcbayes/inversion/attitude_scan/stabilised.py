"""Stabilised attitudes of the catalogue, each tested with its best-fitting facets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.cluster import Run
from lcbayes.core.constants import HOUR_S
from lcbayes.core.errors import InputError
from lcbayes.core.progress import Track
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.albedo_area.distribution import Distribution
from lcbayes.inversion.albedo_area.kernel import Material
from lcbayes.inversion.albedo_area.observed import linear_flux
from lcbayes.inversion.attitude_scan.faceted import best_body
from lcbayes.inversion.attitude_scan.result import Solution
from lcbayes.modelling.ephemeris import ephemeris
from lcbayes.modelling.epochs import Epochs
from lcbayes.physics.attitude import catalogue
from lcbayes.physics.attitude.laws import Attitude, Law, Tabulated, require

Floats = NDArray[np.float64]

ALL = "all"
UNLIT = 1e-4  # share of the total albedo-area below which an array is negligible


def chosen(
    names: Sequence[str], curve: LightCurve, period_h: float | None
) -> tuple[dict[str, Attitude], dict[str, str]]:
    """The distinct laws of these names and, for "all", the untestable ones with the reason.

    Spinning laws take ``period_h``.

    Raises
    ------
    InputError
        A law is unknown, or a law requested by name lacks required data.
    """
    laws: list[Attitude] = []
    left_out: dict[str, str] = {}
    known = ephemeris(curve) if names else None
    for name in names:
        for law in catalogue.distinct() if name == ALL else (_named(name, period_h),):
            if isinstance(law, Law) and law.spins and law.period_s is None:
                if period_h is None:
                    left_out[law.name] = "it spins, and no --period is given"
                    continue
                law = law.set(period_s=HOUR_S * period_h)
            try:
                assert known is not None
                require(law, known)
            except InputError as fault:
                if name != ALL:
                    raise
                left_out[law.name] = str(fault)
                continue
            laws.append(law)
    if names and not laws:
        raise InputError(
            "none of the laws can be tested: " + next(iter(left_out.values()), "none is given")
        )
    return catalogue.by_unique_name(laws), left_out


def _named(name: str, period_h: float | None) -> Attitude:
    """A law with its settings; a spinning law takes the separately given period."""
    if ":" not in name:
        law = catalogue.find(name)
        return law.set(period_s=HOUR_S * period_h) if law.spins and period_h is not None else law
    return catalogue.parse(name)


def fit_laws(
    curve: LightCurve, laws: Mapping[str, Attitude], reflectance: str, run: Run, track: Track
) -> tuple[list[Solution], dict[str, str]]:
    """Each law with its best-fitting facets on a grid and on its array. Laws that are redundant
    because their array reflects no light are returned separately, with the reason."""
    names = list(laws)
    known = ephemeris(curve)
    made = [law.frames(known) for law in laws.values()]
    rows = [(np.asarray(m.body), None if m.array is None else np.asarray(m.array)) for m in made]
    flux, _ = linear_flux(curve, Epochs.of(curve))
    mean = (np.bincount(curve.curve, np.abs(flux)) / np.bincount(curve.curve))[curve.curve]
    out: dict[int, Solution] = {}
    dark: dict[str, str] = {}
    for i, body in run(_fitted, (curve, reflectance), rows):
        name = names[i]
        track.advance(1, name)
        unlit = rows[i][1] is not None and body.areas[-2:].sum() < UNLIT * body.areas.sum()
        if unlit and (rigid := _without_array(laws[name], laws)):
            dark[name] = f"its array sends no light, and without it is {rigid}"
            continue
        residual = (flux - body.flux) / mean
        out[i] = Solution(
            name,
            body.chi2,
            float(np.sqrt(np.mean(residual**2))),
            residual,
            body.normals,
            body.areas / max(body.areas.sum(), 1e-300),
        )
    return [out[i] for i in sorted(out)], dark


def _without_array(law: Attitude, others: Mapping[str, Attitude]) -> str:
    """The name of another law with the same body attitude and no array, or an empty string."""
    for name, other in others.items():
        if isinstance(law, Law) and isinstance(other, Law) and not other.array:
            bare = (other.point, other.clock, other.spins)
            if bare == (law.point, law.clock, law.spins) and _offset(law) == _offset(other):
                return name
    return ""


def _offset(law: Law) -> tuple[float, ...]:
    return tuple(float(x) for x in (law.yaw_deg, law.pitch_deg, law.roll_deg))


def _fitted(shared: tuple, frames: Floats, array: Floats | None) -> Distribution:
    curve, reflectance = shared
    return best_body(
        curve,
        Tabulated(frames),
        Material.parse(reflectance),
        array=None if array is None else Tabulated(array),
    )
