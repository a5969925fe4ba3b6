"""General infrastructure: JAX set-up, files, TOML, errors, progress, threads, cluster."""
