"""`lcbayes simulate`: a light curve from a scenario, with the truth."""
