"""Recursive Gaussian filters over a state space, and the one driver that runs them."""

from seatrial.compiled import engine

engine.prepare()
