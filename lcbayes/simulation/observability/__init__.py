"""Observability of a planned light curve: Fisher information, its limits, and scheduling.

`measurements`: information of each measurement on the attitude. `parameters`, `campaign`:
information of all measurements on attitude, spin, facets and surface. `trades`: unconstrained
combinations of parameters, in words. `linearity`: validity of the bounds. `planning`: choice of the
next measurements; `campaign_plan`, `targets`: the same for a scenario, given its priors or an
earlier fit. `summary`: the results as numbers and in words.
"""
