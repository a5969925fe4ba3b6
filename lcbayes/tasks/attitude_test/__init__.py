"""`lcbayes attitude-test`: attitude laws consistent with the measurements, without a shape."""
