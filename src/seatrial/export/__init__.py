"""Estimated vehicles out to simulators, and trials out to vehicles."""
