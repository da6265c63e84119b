"""Excitation: inputs that make a trial informative, and the limits they must keep."""

from seatrial.compiled import engine

engine.prepare()
