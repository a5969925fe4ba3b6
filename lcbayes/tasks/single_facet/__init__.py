"""`lcbayes single-facet`: orientation of one large facet from the crossing of its edge."""
