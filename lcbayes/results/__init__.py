"""The store: results folders, the posterior file, summaries and verdicts."""
