"""Markov kernels: AHMC, HMC, RMHMC and Metropolis-Hastings, for NumPyro's MCMC."""

from lcbayes.kernels.numpyro_kernel import AHMC, HMC, RMHMC, MetropolisHastings

__all__ = ["AHMC", "HMC", "RMHMC", "MetropolisHastings"]
