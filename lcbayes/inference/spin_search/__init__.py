"""Complete search over constant spins: every cell of pole and rate, from coarse to fine in time."""
