"""Scenario files, simulated light curves and the observability of a campaign."""
