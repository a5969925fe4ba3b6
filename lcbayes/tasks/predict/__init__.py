"""`lcbayes predict`: brightness at other times."""
