"""Physics: vehicle models from coefficient names, the catalogue of published vehicles, and the bridge to filters."""

from seatrial.core import engine

engine.prepare()
