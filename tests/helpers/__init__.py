"""What several tests share: simulated light curves, known densities, limits of chance."""
