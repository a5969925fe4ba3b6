"""Posterior inference from a light curve: search, chains, particles and evidence.

There are two main tasks: `fit` samples a posterior, and `facet_count` compares numbers of facets. A
fit begins with a multi-start `search`, whose distinct optima are the `solutions`. Chains started at
each solution give the `modes`, which are weighted by bridge sampling. With tempered SMC, `basins`
assigns particles to basins of attraction and measures their evidence, and `population` turns the
basins into solutions. A comparison runs SMC for each number of facets. It computes `odds` from the
evidences, cross-validation scores (`loo`) and the `sparse` path of Linares & Crassidis.
"""
