"""Mathematics without vehicles: small triangular algebra, sigma points, one-step integrators."""

from seatrial.core import engine

engine.prepare()
