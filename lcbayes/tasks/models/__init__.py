"""`lcbayes models`: the models that can be fitted, and their options."""
