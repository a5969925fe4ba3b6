"""Scenario files, simulated light curves, and what a campaign could tell."""
