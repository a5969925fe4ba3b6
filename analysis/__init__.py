"""Figures, tables and pages from results; no code here changes a result."""
