"""`lcbayes doctor`: check whether this machine can run the package, with remedies."""
