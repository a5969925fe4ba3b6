"""From a model and a light curve to a posterior: search, chains, particles, evidence.

`problem` makes functions of one flat vector out of a NumPyro model; `fit` and `compare` are the two
main jobs. Fit: `search` from many starts, `solutions` told apart, `sample` by `chains` about each,
`evidence` of each, `modes` joined and weighed. Or `smc`, particles along `path` from the prior, by
`moves`; `regions` tells apart and measures where they end, `population` makes solutions of it.
Compare: `smc` and `regions` for each number of facets, `odds` from the evidences, `loo` beside
them, `sparse` the path of the paper.
"""
