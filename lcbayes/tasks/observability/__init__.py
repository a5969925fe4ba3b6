"""`lcbayes observability`: what a campaign can tell."""
