"""`lcbayes albedo-area`: albedo-area distribution, shape cues and convex shape."""
