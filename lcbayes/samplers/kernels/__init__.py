"""Markov kernels: AHMC, HMC, RMHMC and Metropolis-Hastings, for NumPyro's MCMC."""

from lcbayes.samplers.kernels.numpyro_kernel import AHMC, HMC, RMHMC, MetropolisHastings

__all__ = ["AHMC", "HMC", "RMHMC", "MetropolisHastings"]
