"""What a facet sends to the observer: attitude, reflectance, brightness, photometry. Pure JAX."""
