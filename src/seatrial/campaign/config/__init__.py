"""Reads a campaign file once: TOML, units and checks end here, and what leaves is plain data in SI."""
