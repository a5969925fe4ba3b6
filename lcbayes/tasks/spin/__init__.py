"""`lcbayes spin`: sidereal period and pole from the variation of the synodic period."""
