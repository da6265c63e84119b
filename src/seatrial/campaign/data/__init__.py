"""The trials' records: simulated, or imported from logs, and checked."""
