"""Albedo-area distributions: what faces each direction of a body, given its attitude.

`observed` turns a light curve and an attitude into linear flux and directions in the body frame;
`kernel` says what a unit of albedo-area of a material sends; `nnls` solves for areas that are not
negative; `distribution` does so on a grid of normals, with scales of curves and penalties; `facets`
goes on to the few facets that explain the data; `bootstrap` says how well all this is known;
`cues` says what body it points to; `inversion` does it all.
"""
