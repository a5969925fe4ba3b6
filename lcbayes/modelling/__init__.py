"""What a NumPyro model is made of: epochs, priors, likelihood, pass effects,
registry, log density."""
