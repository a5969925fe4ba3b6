"""`lcbayes glints`: glints, and the directions of the facets, cylinders or panels behind them."""
