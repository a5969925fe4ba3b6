"""The search for the motion of a body of known shape, whose surface may be unknown.

The unknowns are the pole, the rate, the phase and, unless the spin is flat, which axis of the body
is along the pole. Between passes, a body may turn many times, so that the phase of each arc of the
light curve is first free:

1. `cells`: all poles, body axes and rates are visited, with the best phase of each arc and the best
   reflectances, in which the flux is linear (`surface`).
2. `phases`: the best of them start an optimisation of all parameters from all pairs of phases of
   two arcs. The phases of all arcs remain free.
3. `turns`: the numbers of turns between arcs that agree with those phases start an optimisation of
   the posterior.

A glint outshines the rest many times over, and an attitude that is wrong by a few degrees moves it.
The first steps therefore count errors relative to each point's flux. The directions of the pole and
of the axis need a grid of fixed width, because turning ω turns the attitudes of all epochs alike
(`spin_search.cells`).
"""
