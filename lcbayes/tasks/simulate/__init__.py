"""`lcbayes simulate`: a light curve from a scenario, and the truth beside it."""
