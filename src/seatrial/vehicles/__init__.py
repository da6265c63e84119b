"""Physics: vehicle models from coefficient names, the catalogue of published vehicles, and the bridge to filters."""

from seatrial.compiled import engine

engine.prepare()
