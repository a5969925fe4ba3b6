"""`lcbayes compare`: how many facets."""
