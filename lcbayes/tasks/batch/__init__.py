"""`lcbayes batch`: many objects."""
