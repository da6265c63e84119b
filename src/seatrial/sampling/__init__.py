"""Samplers that see only a log-density, and the diagnostics of what they drew."""

from seatrial.compiled import engine

engine.prepare()
