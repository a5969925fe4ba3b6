"""`lcbayes attitude-test`: which attitude laws the measurements allow, without a shape."""
