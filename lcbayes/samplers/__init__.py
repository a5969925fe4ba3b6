"""MCMC kernels, chains, tempered SMC, bridge sampling, convergence checks."""
