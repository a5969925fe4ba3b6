"""Facets, shapes, convex polyhedra and the Minkowski problem."""
