"""From a model and a light curve to a posterior: search, chains, particles, evidence.

Two main jobs: `fit` samples a posterior, `facet_count` compares numbers of facets. A fit begins
with a multi-start `search`, whose distinct optima are the `solutions`; chains about each give
`modes`, weighted by bridge sampling. With tempered SMC, `basins` assigns particles to basins of
attraction and measures their evidence, and `population` makes solutions of them. A comparison runs
SMC for each number of facets and gives `odds` from the evidences, `loo` beside them, and the
`sparse` path of Linares & Crassidis.
"""
