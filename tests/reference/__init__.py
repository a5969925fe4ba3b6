"""Posteriors whose moments are known without a Markov chain; `make.py` writes them."""
