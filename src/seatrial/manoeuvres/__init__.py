"""Excitation: inputs that make a trial informative, and the limits they must keep."""

from seatrial.core import engine

engine.prepare()
