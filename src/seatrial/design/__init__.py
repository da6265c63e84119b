"""How much a trial would teach, and which of many teaches most."""

from seatrial.core import engine

engine.prepare()
