"""`lcbayes compare`: the number of facets."""
