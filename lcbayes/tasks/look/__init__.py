"""`lcbayes look`: what a light curve holds, and what could be asked of it."""
