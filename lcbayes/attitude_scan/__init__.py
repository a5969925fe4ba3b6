"""Attitude scan: hypotheses of attitude, each solved for its best body, ranked and refined.

`points` is what a scan sees of a light curve; `smooth` a body whose log-areas are harmonics, with
its brightness and Jacobian; `spin` Levenberg-Marquardt over pole, period and that body; `grid` the
hypotheses, which `lcbayes.workers` runs on cores or on a Dask cluster; `faceted` polishes and
judges attitudes with free facets; `solutions` names what is found; `scan` does it all.

References
----------
Hall et al. 2007, sec. 3.4; Kaasalainen, Torppa & Muinonen 2001, Icarus 153, 37.
"""
