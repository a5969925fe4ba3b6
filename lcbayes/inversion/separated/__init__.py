"""Attitude without shape, and shape without attitude: methods that need no inversion.

`attitude_test` asks whether measurements that a law makes alike are alike; `single_facet` where a
facet faces whose edge a pass crosses; `shape_match` which candidate shape has the distribution of
brightness over phase angle that was seen. Each says when its conditions are not met.

References
----------
Hall et al. 2007, secs. 4.3, 4.4 and 5.
"""
