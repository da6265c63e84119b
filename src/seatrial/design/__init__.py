"""How much a trial would teach, and which of many teaches most."""

from seatrial.compiled import engine

engine.prepare()
