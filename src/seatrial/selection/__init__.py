"""Which terms the data support: evidence with its error, model probabilities and the verdict in words."""

from seatrial.compiled import engine

engine.prepare()
