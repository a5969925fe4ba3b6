"""The assumptions of a fit, in sentences."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from lcbayes.data.lightcurve import LightCurve
from lcbayes.data.observers import calibrations, observers
from lcbayes.data.segments import PASS, split
from lcbayes.modelling.ephemeris import velocity_direction_sd_deg
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.known_spin import KnownSpin, bisector_rate
from lcbayes.modelling.registry import Entry
from lcbayes.modelling.zero_points import SHARED
from lcbayes.physics.photometry import SUN_MAGNITUDE
from lcbayes.simulation.known_bodies.reader import body_text, described, read_body_text
from lcbayes.tasks.task import ASTEROIDS

FRAMES = {
    "icrs": "the axes of ICRS",
    "ecliptic-j2000": "the axes of the ecliptic of J2000",
    "inertial": "the inertial axes of the file",
}
NOISE = {
    "student-t": "Noise follows Student's t of 4 degrees of freedom: outliers weigh less.",
    "mixture": "Some points are outliers, which scatter more widely; how many is inferred.",
}
UNSURE_DEG = 1.0  # 1 sd of the direction of flight above which it is reported


def assumptions(curve: LightCurve, entry: Entry, options: Mapping[str, Any]) -> list[str]:
    """Assumptions about the body, the spin and the noise of a fit."""
    return [*_of_body(curve, entry, options), *_of_data(curve, entry, options)]


def _of_body(curve: LightCurve, entry: Entry, options: Mapping[str, Any]) -> Iterator[str]:
    model = entry.name
    frame = FRAMES.get(curve.frame, curve.frame)
    if model in ("faceted", "faceted-brdf"):
        how = "that reflect diffusely and do" if model == "faceted" else "that do"
        yield f"The body is flat facets {how} not shade one another."
        yield {
            "free": f"It turns at a constant angular velocity; its axes are {frame} at the start.",
            "none": f"It does not turn in {frame}.",
            "torque-free": "It is rigid and no torque acts on it; angular velocity and inertia "
            f"are those at the start, where its axes are {frame}.",
        }[str(options.get("spin", "free"))]
        yield from _of_known_spin(curve, options)
    elif model in ASTEROIDS:
        yield {
            "convex-grid": "The body is convex, and spins about a fixed axis of its own.",
            "contact-binary": "The body is two ellipsoids in contact that shade one another, and "
            "spins about a fixed axis of its own, across the line of their centres.",
        }[model]
        near = _shown(options["period"])
        yield f"Its sidereal period is near {near} h; other periods were not searched."
    elif model == "body":
        yield from _of_known_body(options)
        yield from _of_known_spin(curve, options)
    elif model == "stabilised":
        yield "The body is flat facets that do not shade one another."
        law = options.get("law", "yaw-steering")
        yield f"Its attitude follows the law {law}; normals are in the axes of that law."
        if (unsure := velocity_direction_sd_deg(curve) or 0.0) > UNSURE_DEG:
            yield (
                "Directions of flight, where a law asks for them, come from the places of the file "
                f"and are unsure by up to {unsure:.0f} deg; elements (--tle) give better ones."
            )


def _of_known_body(options: Mapping[str, Any]) -> Iterator[str]:
    """What is assumed of a body of known shape."""
    file = read_body_text(body_text(str(options["body"])))
    shaded = options.get("shadows", True) and file.body.assembly.shaded
    shade = "shade and hide" if shaded else "do not shade"
    parts = f" Its parts {shade} one another." if len(file.body.names) > 1 else ""
    yield f"The body is {described(file)}.{parts}"
    symmetry, flat = file.body.symmetry, options.get("spin", "flat") == "flat"
    if flat:
        axis = ", ".join(f"{x:.3g}" for x in file.body.flat_axis)
        yield f"It turns at a constant rate about its axis ({axis}), in axes of the body."
    else:
        yield "It turns at a constant angular velocity, about any axis of the body."
    if not flat and symmetry.axis is not None:
        yield "The angle about its axis of symmetry does not matter and is left out."
    elif len(symmetry.rotations) > 1:
        yield (
            f"It looks the same in {len(symmetry.rotations)} attitudes, or fewer for a flat spin; "
            "they are one solution."
        )


def _of_known_spin(curve: LightCurve, options: Mapping[str, Any]) -> Iterator[str]:
    """The prior of the spin, if a period or a pole was given."""
    known = KnownSpin.of(options.get("period", ""), options.get("pole", ""))
    if known is not None:
        rate = float(bisector_rate(Epochs.of(curve)))
        axes = "GCRS" if curve.frame == "icrs" else FRAMES.get(curve.frame, curve.frame)
        yield from known.sentences(rate, axes, constant=options.get("spin") != "torque-free")


def _of_faults(curve: LightCurve, values: Mapping[str, Any], *, drifting: bool) -> Iterator[str]:
    """What is assumed of zero points, clocks and the rate of rotation.

    ``drifting``: whether the rate may drift in the search for solutions.
    """
    seen_by = observers(curve)
    groups = calibrations(curve, seen_by)
    if seen_by.source == "directions":
        yield (
            f"The directions are those of {len(seen_by.names)} observers, because one observer "
            "cannot have them at these times; give a column site if this is wrong."
        )
    several = len(seen_by.names) > 1
    if groups.names:
        sd, spread = (values.get(f"zero_point_{k}", 0.0) for k in ("sd", "spread"))
        shared = groups.series_names and not values.get("nutation_ratio", 0.0)
        part = f"A part of them, a priori {100 * SHARED:.0f} % of their variance"
        common = f" {part}, is common to all nights of a site." if shared else ""
        about, inferred = ("about ", "; by how much is inferred") if spread else ("", "")
        listed = f"{len(groups.names)} sites and nights" if several else "several nights"
        yield (
            f"The zero points of {listed} are uncertain by {about}{sd:g} mag each "
            f"(zero_point_sd){inferred}.{common}"
            if sd
            else f"The zero points of {listed} agree."
        )
    if several:
        sd = values.get("clock_sd", 0.0) if values.get("spin") != "none" else 0.0
        yield (
            f"The clock of each of {len(seen_by.names)} sites is uncertain by {sd:g} s (clock_sd)."
            if sd
            else "The clocks of the sites are exact."
        )
    sd = values.get("rate_drift_sd", 0.0) if values.get("spin") != "none" else 0.0
    if sd and len(split(curve.t, seen_by.index, PASS)) > 1:
        yield (
            f"The rate of rotation may change by {100 * sd:g} % over the light curve "
            "(rate_drift_sd), less where that would be a turn; omega is its mean."
            + (
                ""
                if drifting
                else " The search for solutions takes it as constant, unless nothing then explains "
                "the data."
            )
        )


def _of_nutation(values: Mapping[str, Any]) -> Iterator[str]:
    if values.get("spin") != "free" or not values.get("nutation_sd"):
        return
    if ratio := values.get("nutation_ratio"):
        yield (
            f"The body nutates by some {values['nutation_sd']:g} deg (nutation_sd) at {ratio:.3g} "
            "times its rate of rotation (nutation_ratio); omega and normals are those of the mean "
            "motion."
        )


def _shown(value: Any) -> str:
    """The value of an option; ten digits of a number, since one that is handed over has more."""
    return f"{value:.10g}" if isinstance(value, float) else str(value)


def _of_data(curve: LightCurve, entry: Entry, options: Mapping[str, Any]) -> Iterator[str]:
    short = {k: v for k, v in options.items() if "\n" not in str(v)}
    if short:
        yield "Options: " + ", ".join(f"{k} = {_shown(v)}" for k, v in sorted(short.items())) + "."
    if np.any(curve.free_scale):
        n = int(np.sum(curve.free_scale))
        yield f"The scale of {n} of {curve.n_curves} curves is unknown and inferred."
    added = entry.name == "stabilised" and options.get("scatter", 1.0)
    values = {o.name: o.default for o in entry.options.values()} | dict(options)
    law = str(values.get("noise_law", ""))
    yield (
        "A scatter beyond the errors of the file is inferred."
        if curve.error is not None and added
        else "The errors of the file are taken as they are, independent"
        + (" and Gaussian." if law == "gaussian" else ".")
        if curve.error is not None
        else "The file has no errors; a noise level is inferred"
        + (" for each curve." if curve.n_curves > 1 and not added else ".")
    )
    if law in NOISE:
        yield NOISE[law]
    yield from _of_faults(curve, values, drifting=entry.searched(options).get("rate_drift_sd") != 0)
    yield from _of_nutation(values)
    unknown = sorted({str(b) for b in curve.band if str(b) and str(b) not in SUN_MAGNITUDE})
    if curve.kind == "mag" and unknown:
        yield f"The Sun's V magnitude was used for the band {', '.join(unknown)}."
    if notes := curve.source.get("notes"):
        yield f"Noted on reading the file: {str(notes).removesuffix('.')}."
