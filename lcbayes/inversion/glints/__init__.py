"""Glints: detection in a light curve, and directions of facets, cylinders and panels."""

from lcbayes.inversion.glints.attitude import Glints, analyse

__all__ = ["Glints", "analyse"]
