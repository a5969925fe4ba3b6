"""The gallery: one NumPyro model per file, each about a page, composed of the library's priors.

A model file, from the gallery or a user, defines ``model(data, *, option=default, ...)``; see
`lcbayes.modelling.registry` for other names it may define.
"""
