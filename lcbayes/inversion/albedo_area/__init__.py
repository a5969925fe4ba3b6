"""Albedo-area distributions: albedo-area per direction of the normal, for known attitude.

`observed` turns a light curve and an attitude into linear flux and directions in the body frame;
`kernel` gives the flux of a unit albedo-area of a material; `nnls` solves for non-negative areas;
`distribution` applies it on a grid of normals, with curve scales and penalties; `facets` reduces
the grid to the few facets that explain the data; `bootstrap` estimates the uncertainties; `cues`
tests for features of the body's shape; `inversion` combines all steps.
"""
