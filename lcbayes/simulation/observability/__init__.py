"""What a light curve can tell before it is taken: information, its limits, and when to look.

`measurements`: what each measurement says of the attitude. `parameters`, `campaign`: what all of
them say together of attitude, spin, facets and surface. `trades`: what they leave open, in words.
`linearity`: how far the bounds may be believed. `planning`: which measurements to take next;
`campaign_plan`, `targets`: those of a scenario, given its priors or an earlier fit.
`summary`: the numbers of all of it, and in words.
"""
