"""What any program needs: JAX set-up, files, TOML, errors, progress, threads, cluster."""
