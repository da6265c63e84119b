"""Likelihoods, priors, posteriors and the fast normal approximation at their mode."""

from seatrial.core import engine

engine.prepare()
