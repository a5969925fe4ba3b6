"""Spin without shape: how the synodic period varies along passes gives pole and sidereal period.

``estimate`` does it all; the parts are ``passes``, ``periods``, ``windows`` and ``pole``.
"""

from lcbayes.inversion.spin.sidereal import Spin, estimate

__all__ = ["Spin", "estimate"]
