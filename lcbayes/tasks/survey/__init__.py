"""`lcbayes survey`: the spins of all objects of a catalogue of sparse points."""
