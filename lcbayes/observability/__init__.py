"""What a light curve can tell before it is taken: information, its limits, and when to look.

`measurements`: what each measurement says of the attitude. `parameters`, `campaign`: what all of
them say together of attitude, spin, facets and surface. `trades`: what they leave open, in words.
`planning`, `candidates`: which measurements to take next.
"""
