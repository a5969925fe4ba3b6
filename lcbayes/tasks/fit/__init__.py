"""`lcbayes fit`: posterior over shape, spin and surface."""
