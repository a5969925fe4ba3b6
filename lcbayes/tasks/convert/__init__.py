"""`lcbayes convert`: a light curve in any format, rewritten as CSV or ECSV with directions."""
