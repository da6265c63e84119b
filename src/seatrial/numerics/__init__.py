"""Mathematics without vehicles: small triangular algebra, sigma points, one-step integrators."""

from seatrial.compiled import engine

engine.prepare()
