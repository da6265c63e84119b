"""Likelihoods, priors, posteriors and the fast normal approximation at their mode."""

from seatrial.compiled import engine

engine.prepare()
