"""The gallery: one NumPyro model a file, each about a page, composed from the library's priors.

A model file, ours or a user's, defines ``model(data, *, option=default, ...)``; see
`lcbayes.modelling.registry` for the names it may define besides.
"""
