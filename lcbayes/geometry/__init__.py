"""Times, Earth and Sun, sites, two-line elements, directions to Sun and observer."""
