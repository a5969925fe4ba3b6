"""One folder a command: what `lcbayes.fit`, `lcbayes.scan` and the others do."""
