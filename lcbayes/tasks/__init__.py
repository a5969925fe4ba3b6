"""The tasks `lcbayes.fit`, `lcbayes.scan` and others, one folder per command."""
