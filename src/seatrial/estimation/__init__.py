"""Likelihoods, priors, posteriors and the fast normal approximation at their mode."""
