"""Times, the Earth and the Sun, sites, two-line elements, directions to Sun and observer."""
