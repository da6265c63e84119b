"""Readers of real logs into records: channel maps, clocks, alignment and quality checks."""
