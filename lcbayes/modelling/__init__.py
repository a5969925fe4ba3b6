"""Components of NumPyro models: epochs, priors, likelihood, pass effects, registry, log density."""
