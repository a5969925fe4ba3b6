"""`lcbayes spin`: sidereal period and pole from how the synodic period varies."""
