"""The options of models on the command line."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Iterable, Mapping
from typing import Any

from lcbayes.core.errors import InputError

# Those that have a flag of their own; --set gives any other.
FLAGS = {
    "n_facets": (int, "N", "number of facets (of grid normals for convex-grid)"),
    "period": (float, "HOURS", "sidereal period, about"),
    "law": (str, "NAME", "reflectance law; for stabilised the attitude law"),
    "reflectance": (str, "NAME", "reflectance law, for stabilised"),
    "facets": (str, "LIST", "facets of known normals, for stabilised: +z,array:+x~5"),
    "noise_law": (str, "NAME", "gaussian, student-t or mixture"),
    "spin": (str, "KIND", "free, none for a body that does not turn, torque-free"),
}


def add_model_arguments(parser: ArgumentParser, names: Iterable[str]) -> None:
    """Add the flags of those names, and --set for the rest."""
    for name in names:
        kind, letter, text = FLAGS[name]
        flag = "--noise" if name == "noise_law" else "--" + name.replace("_", "-")
        parser.add_argument(flag, dest=name, type=kind, metavar=letter, help=text)
    parser.add_argument(
        "--set", action="append", default=[], metavar="NAME=VALUE", help="an option of the model"
    )


def add_settings(parser: ArgumentParser, texts: Mapping[str, str]) -> None:
    """Add a flag with a whole number for each name."""
    for name, text in texts.items():
        parser.add_argument(
            "--" + name.replace("_", "-"), dest=name, type=int, metavar="N", help=text
        )


def model_options(args: Namespace) -> dict[str, Any]:
    """The options that were given; what --set says comes last."""
    given = {k: getattr(args, k) for k in FLAGS if getattr(args, k, None) is not None}
    for pair in args.set:
        name, equals, value = pair.partition("=")
        if not equals:
            raise InputError(f"--set {pair}: expected NAME=VALUE, such as --set omega_sd=0.2")
        given[name.strip().replace("-", "_")] = value.strip()
    return given
