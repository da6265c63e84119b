"""Whole workflows on a plain directory: one TOML file in, results that survive a kill out."""

from seatrial.compiled import engine

engine.prepare()
