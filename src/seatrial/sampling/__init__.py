"""Samplers that see only a log-density, and the diagnostics of what they drew."""

from seatrial.core import engine

engine.prepare()
