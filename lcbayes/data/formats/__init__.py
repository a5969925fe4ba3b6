"""File formats of light curves, one module each."""
