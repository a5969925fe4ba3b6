"""Scenarios and light curves that ship with the package."""
