"""`lcbayes observability`: what a campaign can determine."""
