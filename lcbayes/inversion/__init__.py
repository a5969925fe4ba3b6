"""Deterministic inversions: albedo-area distribution, attitude scan, spin, glints, and tests of
attitude and shape."""
