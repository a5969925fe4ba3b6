"""Attitude without shape, and shape without attitude: methods without inversion.

`attitude_test` tests whether measurements with equal geometry under a law have equal brightness.
`single_facet` finds the orientation of a facet from its edge crossing during a pass. `shape_match`
finds candidate shapes that reproduce the observed distribution of brightness with phase angle. Each
method reports unmet conditions.

References
----------
Hall et al. 2007, secs. 4.3, 4.4 and 5.
"""
