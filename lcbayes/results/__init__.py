"""Results folders, the posterior file, summaries and verdicts."""
