"""Attitude scan: hypotheses of attitude, each solved for its best body, ranked and refined.

`points` is what a scan sees of a light curve; `smooth` a body whose log-areas are harmonics, with
its brightness and Jacobian; `spin` Levenberg-Marquardt over pole, period and that body; `grid` the
hypotheses, which `search` spreads over `lcbayes.core.cluster`; `faceted` polishes spins with free
facets and finds the best body under an attitude, `stabilised` the laws of the catalogue;
`solutions` tells ends apart and relates them; `equivalence` says which fit as well as the best;
`engine` does it all, `result` holds it, `verdict` puts it in words.

References
----------
Hall et al. 2007, sec. 3.4; Kaasalainen, Torppa & Muinonen 2001, Icarus 153, 37.
"""
