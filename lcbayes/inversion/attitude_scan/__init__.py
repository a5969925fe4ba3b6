"""Attitude scan: the best body is fitted to each attitude hypothesis; the best are refined.

`points` holds the data of a scan. `smooth` defines a body whose log-areas are harmonics, with its
brightness and Jacobian. `spin` applies Levenberg-Marquardt to pole, period and that body. `grid`
defines the hypotheses, and `search` distributes them over `lcbayes.core.cluster`. `faceted` refines
spins with free facets and finds the best body for an attitude; `stabilised` does so for the laws of
the catalogue. `solutions` identifies distinct end points and relates them. `equivalence` gives the
limit up to which solutions fit as well as the best. For sparse points, `periodogram` ranks all
spins with the linear model of `harmonics`, `evidence` computes their probabilities on cells of the
sphere (`sphere_cells`), and `sparse` turns them into solutions. `engine` runs all steps, `result`
holds the result, and `verdict` describes it in words.

References
----------
Hall et al. 2007, sec. 3.4; Kaasalainen, Torppa & Muinonen 2001, Icarus 153, 37.
"""
