"""Reflected light of faceted bodies: attitude, reflectance, brightness, photometry. Pure JAX."""
