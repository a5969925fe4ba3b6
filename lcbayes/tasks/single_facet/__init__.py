"""`lcbayes single-facet`: orientation of one large facet from its appearance or disappearance."""
