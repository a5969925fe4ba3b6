"""Spin without shape: pole and sidereal period from the synodic period along passes.

``estimate`` runs all steps; the parts are ``passes``, ``periods``, ``windows`` and ``pole``.
"""

from lcbayes.inversion.spin.sidereal import Spin, estimate

__all__ = ["Spin", "estimate"]
